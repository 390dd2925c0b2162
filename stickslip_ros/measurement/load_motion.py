# SPDX-License-Identifier: Apache-2.0
"""The motion in a file, whatever kind it is: a trace, a table, a bag, or parameters to simulate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from stickslip_ros.measurement.reading import MeasurementError, Reading, read_measurement
from stickslip_ros.measurement.reading.bags import SLIDER, is_bag, joint_columns, read_bag
from stickslip_ros.measurement.reading.choice import choose
from stickslip_ros.measurement.reading.motion import motion_of, naming
from stickslip_ros.measurement.reading.quantities import MOTION
from stickslip_ros.parameters import PARAMETERS, Parameters, Value
from stickslip_ros.recordings import open_bag, recorded_axes
from stickslip_ros.traces.motion import Motion, through_bandwidth
from stickslip_ros.traces.runs import Run
from stickslip_ros.traces.trace import PlannedRun, trace_runs

#: Samples in a period of ringing; of so many steps and more they are spared, to keep the memory.
_DENSE, _MANY_STEPS = 40.0, 500
#: Fewest such samples; cubic lines between them are a hundredth of a nanometre off.
_SPARSE = 10.0
#: Steps whose samples fit into memory.
_MOST_STEPS = 8000
#: Part by which a frequency may differ from that of the parameters: the clocks' fault.
_SAME = 0.01


class LoadedMotion(NamedTuple):
    """A motion and what its file says about it.

    :ivar origin_ns: the time (ns since the Unix epoch) that its times count from, of a bag.
    :ivar parameters: of the axis when it started, if the file holds them.
    :ivar version: of this package that the axis ran with, likewise.
    """

    motion: Motion
    origin_ns: int | None = None
    parameters: dict[str, Value] | None = None
    version: str | None = None


def is_parameter_file(path: Path) -> bool:
    """Return whether a path is that of a parameter file."""
    return path.suffix.lower() in (".yaml", ".yml")


def load_motion(
    path: Path,
    how: Reading | None = None,
    joint: str | None = None,
    origin_ns: int | None = None,
) -> LoadedMotion:
    """Read a motion from a bag, a trace that we wrote, or a measurement of any format.

    :param how: what has to be said of the file, such as which columns are time and position.
    :param joint: in a bag; None: the first whose name ends in ``_slider``, or the only one.
    :param origin_ns: time that the stamps of a bag count from; None: its first message.
    :raises MeasurementError: a table cannot be read, or has no such joint.
    :raises BagError: a bag cannot be read.
    """
    how = how or Reading()
    if not is_bag(path):
        return LoadedMotion(read_measurement(path, how))
    with naming(path):
        table, origins = read_bag(path)
        if not how.columns:
            how = replace(how, columns=joint_columns(table, joint))
        position = choose(table, MOTION, how).columns["x"]
        motion = motion_of(table, path.name, how)
    # Whole nanoseconds, so that both of two bags that are compared count alike.
    stamps = origins[position.number - 1] + np.rint(1e9 * motion.t).astype(np.int64)
    origin = int(stamps[0]) if origin_ns is None else origin_ns
    motion = replace(motion, t=np.asarray(1e-9 * (stamps - origin), np.float64))
    return LoadedMotion(motion, origin, *_axis_of(path, position.name.split("/")[-2]))


def _axis_of(path: Path, joint: str) -> tuple[dict[str, Value] | None, str | None]:
    """Return parameters and version of the axis with a joint, from the event it starts with."""
    with open_bag(path) as bag:
        for texts in recorded_axes(bag).values():
            if f"{texts.get('axis_name')}{SLIDER}" == joint:
                known = {name: text for name, text in texts.items() if name in PARAMETERS}
                parameters = {name: PARAMETERS[name].parse(text) for name, text in known.items()}
                return parameters, texts.get("version")
    return None, None


def simulate_motion(
    p: Parameters,
    runs: int | Sequence[PlannedRun],
    source: str,
    before: float = 0.0,
    after: float = 0.0,
) -> Motion:
    """Run steps from rest; before and after are times (s) of rest.

    runs are the steps (sign: direction) of one run, or several runs. The motion is seen through the
    bandwidth of the sensor, if it has one, without noise and latency. MeasurementError if there are
    no steps or too many, ParameterError.
    """
    if isinstance(runs, int):
        runs = [PlannedRun(0.0, runs)]
    steps = sum(abs(run.steps) for run in runs)
    if not 0 < steps <= _MOST_STEPS or any(run.steps == 0 for run in runs):
        raise MeasurementError(
            f"{steps} steps are to be simulated; it has to be 1 to {_MOST_STEPS}, forward or "
            "backward: give --steps, or cut the measurement with --from and --to"
        )
    density = min(_DENSE, max(_SPARSE, _DENSE * _MANY_STEPS / steps))
    motion = Motion.of_trace(trace_runs(p, runs, density, before, after), source)
    return through_bandwidth(p, motion)


def simulate_as_measured(
    p: Parameters, measurement: Motion, runs: Sequence[Run], source: str
) -> Motion:
    """Simulate the runs found in a measurement, its rests included and a period more on each side.

    A run at the drive's frequency but for a small error has exactly that of the parameters. Raises
    MeasurementError if there are no runs, and as `simulate_motion` does.
    """
    if not runs:
        raise MeasurementError(
            f"no steps are found in {measurement.source}; give a measurement that shows some"
        )
    margin = 1.0 / p.drive.frequency
    planned = [
        PlannedRun(
            run.start,
            run.direction * run.steps,
            None if abs(run.frequency / p.drive.frequency - 1.0) < _SAME else run.frequency,
        )
        for run in runs
    ]
    before = max(runs[0].start - float(measurement.t[0]), 0.0)
    after = max(float(measurement.t[-1]) - runs[-1].end, 0.0)
    return simulate_motion(p, planned, source, before + margin, after + margin)
