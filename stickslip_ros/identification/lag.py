# SPDX-License-Identifier: Apache-2.0
"""A lag of the amplifier: the drive as it arrives at the actuator, in straight pieces.

Behind a first-order lag, u follows the wanted deflection with the time constant of the lag. Between
two kinks that is a straight line and an exponential, which is cut into straight pieces.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.model import DriveCycle
from stickslip_ros.parameters import parameter

Array = NDArray[np.float64]

#: The free parameter (s), where it starts, and where it may lie.
LAG, LAG_START, LAG_BOUNDS = "amplifier_lag", 3e-7, (1e-8, 2e-5)
#: Points of the exponential between two cuts that the straight pieces are laid through.
_DENSE = 12
#: Straight pieces of the slip, and of the bend after it, which lasts so many lags.
_IN_SLIP, _PIECES, _LASTS = 8, 16, 11.0


def lagged(drive_cycle: DriveCycle, count: int, lag: float) -> list[tuple[DriveCycle, int]]:
    """Return what count cycles of a sawtooth become behind a lag (s): (drive cycle, count) pairs.

    They begin when the first cycle begins. A cycle is counted from the end of the bend after the
    slip before: the first piece is the rise up to there, and the last cycle ends at rest.
    """
    rise, fall = drive_cycle.rates.tolist()
    duration, slip = drive_cycle.durations.tolist()
    after = min(_LASTS * lag, 0.5 * duration)
    bend = np.expm1(np.linspace(0.0, math.log(_LASTS + 1.0), _PIECES + 1)[1:]) / _LASTS * after
    slipping = np.linspace(0.0, slip, _IN_SLIP + 1)

    def behind(t: Array, rate: float, before: float) -> Array:
        """Return how far u is behind the wanted deflection, which rises at a rate (m/s)."""
        found: Array = rate * lag + (before - rate * lag) * np.exp(-t / lag)
        return found

    end = float(behind(np.array(slip), fall, rise * lag))

    def closed(next_rise: float) -> DriveCycle:
        """Return rise, slip and bend, with the rise (m/s) that follows the slip."""

        def level(t: Array) -> Array:
            after_slip = np.maximum(t - slip, 0.0)
            wanted = fall * np.minimum(t, slip) + next_rise * after_slip
            late = behind(after_slip, next_rise, end)
            return wanted - np.where(t < slip, behind(t, fall, rise * lag), late)

        nodes = np.concatenate([slipping, slip + bend])
        durations = np.diff(nodes)
        last = fall * slip + next_rise * (after - lag)
        rates = np.diff(_through(nodes, level, last)) / durations
        return DriveCycle(
            np.concatenate([[duration - after], durations]),
            np.concatenate([[rise], rates]),
            slip=1,
            sign=drive_cycle.sign,
            slip_parts=_IN_SLIP,
        )

    begun = np.concatenate([[0.0], bend])
    levels = _through(begun, lambda t: rise * t - behind(t, rise, 0.0), rise * (after - lag))
    first = DriveCycle(np.diff(begun), np.diff(levels) / np.diff(begun), -1, drive_cycle.sign, 0)
    pieces = [(first, 1)]
    if count > 1:
        pieces.append((closed(rise), count - 1))
    return [*pieces, (closed(0.0), 1)]


def _through(nodes: Array, level: Callable[[Array], Array], last: float) -> Array:
    """Return levels at nodes whose straight pieces lie closest to a curve, its ends kept.

    Straight pieces between points of the curve would all lie on one side of it.
    """
    pieces = [np.linspace(a, b, _DENSE, endpoint=False) for a, b in pairwise(nodes.tolist())]
    t = np.concatenate(pieces)
    hats = np.stack([np.interp(t, nodes, one) for one in np.eye(len(nodes))], axis=1)
    weight = np.sqrt(np.repeat(np.diff(nodes), _DENSE))
    ends = np.array([float(level(nodes[:1])[0]), last])
    left = (level(t) - hats[:, [0, -1]] @ ends) * weight
    inner, *_ = np.linalg.lstsq(hats[:, 1:-1] * weight[:, None], left, rcond=None)
    return np.concatenate([ends[:1], inner, ends[1:]])


def starts_of(pieces: Sequence[tuple[DriveCycle, int]], begin: float) -> list[float]:
    """Return when each piece begins (s), the first at begin."""
    found = [begin]
    for drive_cycle, count in pieces[:-1]:
        found.append(found[-1] + count * drive_cycle.period)
    return found


def is_sawtooth(drive_cycle: DriveCycle) -> bool:
    """Return whether a drive cycle is a plain sawtooth: a lag is known of no other here."""
    return len(drive_cycle.rates) == 2 and drive_cycle.slip == 1 and drive_cycle.slip_parts == 1


def unit_of(name: str) -> str:
    """Return the unit of a free parameter."""
    return "s" if name == LAG else parameter(name).unit
