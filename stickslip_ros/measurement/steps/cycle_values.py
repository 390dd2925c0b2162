# SPDX-License-Identifier: Apache-2.0
"""Steps, backsteps and the points of Fig. 2 cycle by cycle."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stickslip_ros.base.arrays import Array
from stickslip_ros.measurement.steps.backstep import MeanSlip
from stickslip_ros.measurement.steps.record import Pyramid, Record
from stickslip_ros.measurement.steps.ringing import Ringing
from stickslip_ros.measurement.steps.run import Cycles
from stickslip_ros.measurement.steps.slips import SlipSizes

#: Part of a period before a slip whose mean tells how far the runner has got; of it, the part at
#: the end that is left out, as slips are not quite even.
_RUN_UP, _UNEVEN = 0.2, 0.01


@dataclass(frozen=True)
class CycleValues:
    """Values of each cycle, (cycles,); nan where they cannot be determined."""

    step_sizes: Array  #: m, with their signs
    backsteps: Array  #: m
    points: dict[str, Array]  #: times of the points of Fig. 2, s


def cycle_values(
    record: Record,
    pyramid: Pyramid,
    cycles: Cycles,
    ringing: Ringing | None,
    slip: MeanSlip,
    settled_step: float,
    driven: bool,
) -> CycleValues:
    """Return the values of cycles; settled_step (m) is the mean of the settled ones.

    The mean slip gives what all cycles have in common, single cycles how far theirs is from it.
    driven: whether the actuator is known.
    """
    position = _before_slips(record, cycles)
    first = float(np.interp(cycles.starts[0], record.t, record.x))
    rise = cycles.direction * abs(settled_step) * (0.5 * _RUN_UP + 0.5 * _UNEVEN)
    steps = np.diff(position, prepend=first - rise)
    sizes = np.full(len(cycles.slips), math.nan)
    if math.isfinite(slip.backstep.value):
        every = SlipSizes(pyramid, cycles.slips, cycles.period, ringing)
        sizes = slip.backstep.value * every.at(cycles.slips)[0]
    return CycleValues(steps, sizes, _points(cycles, ringing, slip, driven))


def _before_slips(record: Record, cycles: Cycles) -> Array:
    """Return the mean position (m) in the last part of each cycle before its slip."""
    begins = np.searchsorted(record.t, cycles.slips - _RUN_UP * cycles.period)
    ends = np.searchsorted(record.t, cycles.slips - _UNEVEN * cycles.period)
    sums = np.concatenate([[0.0], np.cumsum(record.x - record.x[0])])
    count = ends - begins
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = (sums[ends] - sums[begins]) / count
    few = np.interp(cycles.slips, record.t, record.x) - record.x[0]
    return np.asarray(np.where(count > 0, mean, few) + record.x[0])


def _points(
    cycles: Cycles, ringing: Ringing | None, slip: MeanSlip, driven: bool
) -> dict[str, Array]:
    """Return the points of Fig. 2.

    From rest, a runner is as fast as its actuator after a quarter swing. After the deepest point,
    it takes another quarter until the contact has unbent.
    """
    points = {name: np.full(len(cycles.slips), math.nan) for name in "ABCDEF"}
    points["A"], points["C"] = cycles.starts.copy(), cycles.slips.copy()
    points["E"] = cycles.slips + slip.deepest
    if ringing is not None:
        points["F"] = points["E"] + 0.25 * ringing.swing
        if driven:
            points["B"] = cycles.starts + 0.25 * ringing.swing
    return points
