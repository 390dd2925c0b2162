# SPDX-License-Identifier: Apache-2.0
"""Simulates the runs that a measurement shows, as it shows them.

Apart from reading measurements, which needs no solver.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from stickslip_ros.measurement.reading import MeasurementError
from stickslip_ros.measurement.steps.analysis import determined_part, runs_of
from stickslip_ros.measurement.steps.run import Run
from stickslip_ros.physics.parameters import Parameters
from stickslip_ros.simulation.motion import Motion
from stickslip_ros.simulation.readings import through_bandwidth
from stickslip_ros.simulation.sampling import PlannedRun, trace_runs

#: Samples in a period of ringing, and fewest of them: cubic lines between those are a hundredth of
#: a nanometre off. Runs of more steps have fewer, to save memory.
_DENSE, _SPARSE, _MANY_STEPS = 40.0, 10.0, 500
#: Steps whose samples fit into memory.
_MOST_STEPS = 8000
#: Part by which a frequency may differ from that of the parameters: the clocks' fault.
_SAME = 0.01
#: Fewest samples of a part of a cycle that say whether it steps.
_FEWEST = 8


def simulate_motion(
    p: Parameters, runs: Sequence[PlannedRun], source: str, before: float, after: float
) -> Motion:
    """Return the motion of runs of steps from rest; before and after are times (s) of rest.

    It is seen through the bandwidth of the sensor, if it has one, without noise and latency.
    MeasurementError if there are no steps or too many, ParameterError.
    """
    steps = sum(abs(run.steps) for run in runs)
    if not 0 < steps <= _MOST_STEPS or any(run.steps == 0 for run in runs):
        raise MeasurementError(
            f"{steps} steps are to be simulated; it has to be 1 to {_MOST_STEPS}, forward or "
            "backward: give --steps, or cut the measurement with --from and --to"
        )
    density = min(_DENSE, max(_SPARSE, _DENSE * _MANY_STEPS / steps))
    return through_bandwidth(p, Motion(source, *trace_runs(p, runs, density, before, after)))


def simulate_as_measured(
    p: Parameters, measurement: Motion, runs: Sequence[Run], source: str
) -> Motion:
    """Simulate the runs found in a measurement, its rests included and a period more on each side.

    Runs that are not determined are left out as in `determined_part`. A measurement that begins or
    ends within a cycle is simulated so, too. Without runs, those that its actuator shows are
    simulated. A run at the drive's frequency but for a small error has exactly that of the
    parameters. Raises MeasurementError if nothing shows steps, and as `simulate_motion` does.
    """
    measurement, runs = determined_part(measurement, runs or runs_of(measurement))
    if not runs:
        raise MeasurementError(
            f"no steps are found in {measurement.source}; give a measurement that shows some, or "
            "say how many to simulate (--steps)"
        )
    own, margin = p.drive.frequency, 1.0 / p.drive.frequency
    first, last = float(measurement.t[0]), float(measurement.t[-1])
    begin, end = runs[0].start, runs[-1].end
    planned = []
    for run in runs:
        frequency = None if abs(run.frequency / own - 1.0) < _SAME else run.frequency
        planned.append(PlannedRun(run.start, run.direction * run.steps, frequency))
    before, after = max(begin - first, 0.0) + margin, max(last - end, 0.0) + margin
    since, until = -math.inf, math.inf
    if _steps_in(measurement, first, begin, runs[0].period):
        steps = planned[0].steps + runs[0].direction
        planned[0] = replace(planned[0], start=begin - runs[0].period, steps=steps)
        before, since = 0.0, first - planned[0].start
    if _steps_in(measurement, end, last, -runs[-1].period):
        planned[-1] = replace(planned[-1], steps=planned[-1].steps + runs[-1].direction)
        after, until = 0.0, last - planned[0].start
    return simulate_motion(p, planned, source, before, after).between(since, until)


def _steps_in(measurement: Motion, begin: float, end: float, period: float) -> bool:
    """Return whether a part (s) of a measurement, less than a cycle, is not a rest but steps.

    Then it is more like the same part of the cycle beside it, a period (s) away, than like a rest.
    """
    kept = measurement.between(begin, end)
    seen = 0.0 < end - begin < abs(period) and len(kept.t) >= _FEWEST
    # It has the noise of two readings: a rest beside another one is no motion.
    apart = kept.x - measurement.position_at(kept.t + period)
    return seen and bool(np.var(apart) < np.var(kept.x))
