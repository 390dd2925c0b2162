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
from dataclasses import dataclass

import numpy as np
import scipy  # its parts load when they are used, which takes half a second
from numpy.typing import NDArray

from stickslip_ros.base.arrays import Array
from stickslip_ros.measurement.steps.ringing import Ringing

#: c above.
_PUSH = 5.0
#: Part of a period of the ringing in which the onset is sought, and places tried in it first.
_REACH, _PLACES = 0.3, 13
#: Part of a period of the drive by which the window of a cycle begins before its slip.
_CYCLE_BEFORE = 0.3
#: Approximate number of samples for the onsets, and number of their cycles if there are enough.
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


@dataclass(frozen=True)
class Onset:
    """How much later than expected the slips begin: shift + drift (t - middle)."""

    shift: float  #: s
    drift: float  #: s/s
    shift_error: float  #: standard uncertainty, s


def cycle_of(t: Array, slips: Array, period: float) -> NDArray[np.int64]:
    """Return the number of the cycle that each time (s) lies in; a cycle holds its slip inside."""
    return np.searchsorted(slips - _CYCLE_BEFORE * period, t).astype(np.int64)


def thin_samples(t: Array, x: Array, slips: Array, period: float) -> tuple[Array, Array]:
    """Return whole cycles with a limited number of samples, spread over the motion.

    If there are few cycles with very many samples, all cycles stay, with every n-th sample.
    """
    cycle = cycle_of(t, slips, period)
    share = len(t) // _SAMPLES + 1
    apart = min(share, max(1, len(slips) // _CYCLES))
    kept = np.flatnonzero(cycle % apart == 0)[:: -(-share // apart)]
    return t[kept], x[kept]


def detrend(t: Array, columns: list[Array], cycle: NDArray[np.int64]) -> list[Array]:
    """Return the columns without their mean and slope in each cycle."""
    count = np.maximum(np.bincount(cycle), 1)
    time = t - (np.bincount(cycle, t) / count)[cycle]
    square = np.bincount(cycle, time * time)
    square[square == 0.0] = 1.0
    result = []
    for column in columns:
        about = column - (np.bincount(cycle, column) / count)[cycle]
        slope = np.bincount(cycle, about * time) / square
        result.append(about - slope[cycle] * time)
    return result


def find_onset(
    t: Array, x: Array, slips: Array, period: float, ringing: Ringing, drift: bool, middle: float
) -> Onset:
    """Fit the answer to all slips of a motion; slips and middle (s) by the same clock as t."""
    cycle = cycle_of(t, slips, period)
    (position,) = detrend(t, [x], cycle)
    omega, duration = 2.0 * math.pi * ringing.frequency, slips[-1] - slips[0] + period

    def left(trial: Array, part: slice = slice(None)) -> Array:
        # While the contact slides, it rings at another frequency than after it.
        faster, shorter = (math.exp(min(max(one, -_OTHER), _OTHER)) for one in trial[1:3])
        own = Ringing(ringing.frequency * faster, ringing.decay * shorter)
        begin = slips + trial[0] / omega
        if drift:
            begin = begin + trial[3] / omega * (slips - middle) / duration
        time, seen = t[part], position[part]
        bounds = np.concatenate(([0], np.searchsorted(time, begin), [len(time)]))
        after = time - np.repeat(np.append(time[:1], begin), np.diff(bounds))
        cosine, sine = own.columns(after).T
        answer = 1.0 - cosine + _PUSH * own.decay / (2.0 * math.pi * own.frequency) * sine
        answer[: bounds[1]] = 0.0
        (answer,) = detrend(time, [answer], cycle[part])
        size = float(answer @ answer)  # 0 for a place before all samples of the slips
        return np.asarray(seen - answer * (answer @ seen) / size) if size else seen

    # Trials are angles of the ringing: of order one.
    reach = 2.0 * math.pi * _REACH
    few = slice(None, None, max(1, int(1.0 / (np.median(np.diff(t)) * ringing.frequency * _SEEN))))
    tried = [np.array([at, *[0.0] * (2 + drift)]) for at in np.linspace(-reach, reach, _PLACES)]
    first = min(tried, key=lambda one: float(np.sum(left(one, few) ** 2)))
    scale = float(np.std(position)) or 1.0
    found = scipy.optimize.least_squares(
        lambda moved: left(moved - _AWAY) / scale, first + _AWAY, jac="3-point", **_DESCENT
    )
    jacobian, rest = found.jac, found.fun
    # Cycles count as independent of each other; samples do not, because they share the ringing.
    parts = np.stack([np.bincount(cycle, column * rest) for column in jacobian.T], axis=1)
    inverse = np.linalg.pinv(jacobian.T @ jacobian)
    spread = inverse @ (parts.T @ parts) @ inverse
    best = (found.x - _AWAY) / omega
    return Onset(
        float(best[0]), float(best[3] / duration) if drift else 0.0, math.sqrt(spread[0, 0]) / omega
    )
