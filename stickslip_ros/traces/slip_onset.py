# SPDX-License-Identifier: Apache-2.0
"""When the slips of a motion begin, found from the runner's answer to them.

A slip takes the contact's hold away and pulls the runner back: it sets out for a new place of rest
and rings about it. With tau the time since the slip began, omega and delta those of the ringing,

    x = -A (1 - exp(-delta tau) (cos(omega tau) - c delta / omega sin(omega tau))).

A purely elastic contact would give c = 1: the damping pushes, too. In a slip of the CEIM the
asperities yield meanwhile, and c = 3 gives the same onset for runs that differ in damping only.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy  # its parts load when they are used, which takes half a second
from numpy.typing import NDArray

from stickslip_ros.traces.ringing import Ringing

Array = NDArray[np.float64]

#: c above.
PUSH = 3.0
#: Looked for within this part of a period of the ringing, first on so many places of it.
_REACH, _PLACES = 0.3, 13
#: Part of a period of the drive by which the window of a cycle begins before its slip.
_BEFORE = 0.3
#: Samples that tell onsets, about, and cycles that they come from, where there are as many.
_FITTED, _CYCLES = 20_000, 8
#: Added to what is fitted: far more than it reaches.
_AWAY = 10.0


@dataclass(frozen=True)
class Onset:
    """How much later than expected the slips begin: shift + drift (t - middle)."""

    shift: float  #: s
    drift: float  #: s/s
    shift_error: float  #: standard uncertainty, s


def cycle_of(t: Array, slips: Array, period: float) -> NDArray[np.int64]:
    """Return the number of the cycle that each time (s) lies in; a cycle holds its slip inside."""
    return np.searchsorted(slips - _BEFORE * period, t).astype(np.int64)


def some_cycles(t: Array, x: Array, slips: Array, period: float) -> tuple[Array, Array]:
    """Return whole cycles of not too many samples, spread over the motion: they tell as well.

    Of a few cycles with very many samples each, all cycles stay, and every so many samples of them.
    """
    cycle = cycle_of(t, slips, period)
    share = len(t) // _FITTED + 1
    apart = min(share, max(1, len(slips) // _CYCLES))
    kept = np.flatnonzero(cycle % apart == 0)[:: -(-share // apart)]
    return t[kept], x[kept]


def detrended(t: Array, columns: list[Array], cycle: NDArray[np.int64]) -> list[Array]:
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
    t: Array,
    x: Array,
    slips: Array,
    period: float,
    ringing: Ringing,
    drift: bool = False,
    middle: float = 0.0,
    before: float = _REACH,
) -> Onset:
    """Fit the answer to all slips of a motion; slips and middle (s) by the same clock as t.

    before is how much earlier than expected a slip may be, in periods of the ringing.
    """
    cycle = cycle_of(t, slips, period)
    (position,) = detrended(t, [x], cycle)
    omega = 2.0 * math.pi * ringing.frequency

    def left(trial: Array) -> Array:
        begin = slips + trial[0] / omega
        if drift:
            begin = begin + trial[1] / omega * (slips - middle) / (slips[-1] - slips[0] + period)
        number = np.searchsorted(begin, t, side="right") - 1
        began = number >= 0
        after = np.where(began, t - begin[number], 0.0)
        cosine, sine = ringing.columns(after).T
        answer = began * (1.0 - cosine + PUSH * ringing.decay / omega * sine)
        (answer,) = detrended(t, [answer], cycle)
        size = float(answer @ answer)  # 0 for a place before all samples of the slips
        return np.asarray(position - answer * (answer @ position) / size) if size else position

    # Trials are angles of the ringing: of order one.
    reach = 2.0 * math.pi * _REACH
    zeros = [0.0] * drift
    count = round(_PLACES * (before + _REACH) / (2.0 * _REACH))
    places = np.linspace(-2.0 * math.pi * before, reach, count)
    first = min(places, key=lambda place: float(np.sum(left(np.array([place, *zeros])) ** 2)))
    scale = float(np.std(position)) or 1.0
    # Steps of the derivative are parts of a trial: of one near 0, as where all agrees, a step would
    # be lost to rounding.
    found = scipy.optimize.least_squares(
        lambda moved: left(moved - _AWAY) / scale,
        np.array([first, *zeros]) + _AWAY,
        jac="3-point",
        diff_step=1e-3 / _AWAY,
        xtol=1e-6 / _AWAY,
        ftol=1e-10,
    )
    jacobian, rest = found.jac, found.fun
    # Cycles are taken for independent of each other; samples are not, they share the ringing.
    parts = np.stack([np.bincount(cycle, column * rest) for column in jacobian.T], axis=1)
    inverse = np.linalg.inv(jacobian.T @ jacobian)
    spread = inverse @ (parts.T @ parts) @ inverse
    best = found.x - _AWAY
    slope = best[1] / omega / (slips[-1] - slips[0] + period) if drift else 0.0
    return Onset(float(best[0]) / omega, float(slope), math.sqrt(spread[0, 0]) / omega)
