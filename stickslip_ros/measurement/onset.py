# SPDX-License-Identifier: Apache-2.0
"""When the slips of a motion begin, by the answer of a ringing runner to all of them.

With tau the time since the start of a slip, and omega and delta those of the ringing,

    x = -A (1 - exp(-delta tau) (cos(omega tau) - c delta / omega sin(omega tau))),

beside the mean and the slope of each cycle. A purely elastic contact would give c = 1: the damping
pushes, too. In a slip the asperities yield meanwhile. Another c moves the onset by its difference
times delta / omega^2. Of axes that differ in nothing but damping, c = 5 gives the same onset for
most contacts, and c = 3 to 8 for nearly all.
"""

from __future__ import annotations

import math

import numpy as np
import scipy  # its parts load when they are used, which takes half a second
from numpy.typing import NDArray

from stickslip_ros.base.arrays import Array
from stickslip_ros.measurement.steps.ringing import Ringing
from stickslip_ros.measurement.steps.run import Run

#: c above.
_PUSH = 5.0
#: Part of a period of the ringing in which the onset is sought, and places tried in it first.
_REACH, _PLACES = 0.3, 13
#: Part of a period of the drive by which the window of a cycle begins before its slip.
_CYCLE_BEFORE = 0.3
#: Approximate number of samples that are enough, and of their cycles if there are as many.
_SAMPLES, _CYCLES = 20_000, 8
#: So many samples of a swing show about where they are.
_SEEN = 12.0
#: Added to what is fitted: far more than it reaches. Steps of the derivative are parts of a trial:
#: of one near 0, as where all agrees, a step would be lost to rounding.
_AWAY = 10.0
#: Logarithm of the largest factor between the ringing in a slip and after it: where the samples do
#: not show the ringing, the fit has no minimum and would go on to a frequency of 0.
_OTHER = 3.0
_DESCENT = {"diff_step": 1e-3 / _AWAY, "xtol": 1e-6 / _AWAY, "ftol": 1e-10}


def thinned(t: Array, run: Run | None) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return which samples at times (s) are enough, and the number of the cycle of each of them.

    They are whole cycles, each with its slip inside, spread over the motion; without a run, or of
    few cycles with very many samples, every n-th sample of all.
    """
    begins = run.slips - _CYCLE_BEFORE * run.period if run else np.empty(0)
    cycle = np.searchsorted(begins, t).astype(np.int64)
    share = len(t) // _SAMPLES + 1
    apart = min(share, max(1, len(begins) // _CYCLES))
    kept = np.flatnonzero(cycle % apart == 0)[:: -(-share // apart)]
    return kept, cycle[kept]


def beside_lines(t: Array, columns: Array, cycle: NDArray[np.int64]) -> Array:
    """Return columns, (samples, n), without mean and slope in each cycle; its number rises."""
    first = np.flatnonzero(np.diff(cycle, prepend=-1))
    counts = np.diff(np.append(first, len(t)))

    def mean(x: Array) -> Array:
        sums = np.add.reduceat(x, first, axis=0)
        return np.asarray(np.repeat(sums / counts[:, None], counts, axis=0))

    time, about = t[:, None] - mean(t[:, None]), columns - mean(columns)
    square = mean(time**2)
    slope = mean(about * time) / np.where(square > 0.0, square, 1.0)
    return np.asarray(about - slope * time)


def find_onset(t: Array, x: Array, run: Run, ringing: Ringing) -> tuple[float, float]:
    """Return how much later (s) the slips of a run begin in a motion, and the standard uncertainty.

    The motion is at x (m) at times t (s) by the clock of the run, and rings so.
    """
    slips = run.slips[(run.slips > t[0]) & (run.slips < t[-1])]
    some, cycle = thinned(t, run)
    t, position = t[some], beside_lines(t[some], x[some, None], cycle)[:, 0]
    omega = 2.0 * math.pi * ringing.frequency

    def left(trial: Array, part: slice = slice(None)) -> Array:
        # While the contact slides, it rings at another frequency than after it.
        faster, shorter = (math.exp(min(max(one, -_OTHER), _OTHER)) for one in trial[1:])
        own = Ringing(ringing.frequency * faster, ringing.decay * shorter)
        begin = slips + trial[0] / omega
        time, seen = t[part], position[part]
        bounds = np.concatenate(([0], np.searchsorted(time, begin), [len(time)]))
        after = time - np.repeat(np.append(time[:1], begin), np.diff(bounds))
        cosine, sine = own.columns(after).T
        answer = 1.0 - cosine + _PUSH * own.decay / (2.0 * math.pi * own.frequency) * sine
        answer[: bounds[1]] = 0.0
        answer = beside_lines(time, answer[:, None], cycle[part])[:, 0]
        size = float(answer @ answer)  # 0 for a place before all samples of the slips
        return np.asarray(seen - answer * (answer @ seen) / size) if size else seen

    # Trials are angles of the ringing: of order one.
    reach = 2.0 * math.pi * _REACH
    few = slice(None, None, max(1, int(1.0 / (np.median(np.diff(t)) * ringing.frequency * _SEEN))))
    tried = [np.array([at, 0.0, 0.0]) for at in np.linspace(-reach, reach, _PLACES)]
    first = min(tried, key=lambda one: float(np.sum(left(one, few) ** 2)))
    scale = float(np.std(position)) or 1.0
    found = scipy.optimize.least_squares(
        lambda moved: left(moved - _AWAY) / scale, first + _AWAY, jac="3-point", **_DESCENT
    )
    # Cycles count as independent of each other; samples do not, because they share the ringing.
    parts = np.stack([np.bincount(cycle, one * found.fun) for one in found.jac.T], axis=1)
    inverse = np.linalg.pinv(found.jac.T @ found.jac)
    spread = inverse @ (parts.T @ parts) @ inverse
    return float(found.x[0] - _AWAY) / omega, math.sqrt(spread[0, 0]) / omega
