# SPDX-License-Identifier: Apache-2.0
"""The motion in a file, whatever kind it is: a trace, a table, a bag, or parameters to simulate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from stickslip_ros.measurement.reading import MeasurementError, Reading, read_measurement
from stickslip_ros.measurement.reading.bags import is_foreign_bag, joint_columns, read_bag
from stickslip_ros.measurement.reading.motion import motion_of
from stickslip_ros.parameters import PARAMETERS, Parameters, Value
from stickslip_ros.recordings import (
    BagError,
    BagReader,
    decoder_for,
    nanoseconds,
    open_bag,
    recorded_axes,
)
from stickslip_ros.traces.motion import Motion
from stickslip_ros.traces.readings import through_bandwidth
from stickslip_ros.traces.runs import Run
from stickslip_ros.traces.trace import PlannedRun, trace_runs

_JOINT_STATE = "sensor_msgs/msg/JointState"
#: Ends of the names of our joints.
_SLIDER, _PIEZO = "_slider", "_piezo"
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


def is_bag(path: Path) -> bool:
    """Return whether a path is that of a recording."""
    return path.is_dir() or path.suffix.lower() in (".mcap", ".db3", ".bag")


def is_parameter_file(path: Path) -> bool:
    """Return whether a path is that of a parameter file."""
    return path.suffix.lower() in (".yaml", ".yml")


def load_motion(
    path: Path,
    *,
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    how: Reading | None = None,
    joint: str | None = None,
    origin_ns: int | None = None,
) -> LoadedMotion:
    """Read a motion from a bag, a trace that we wrote, or a measurement of any format.

    :param columns: of position and time, by name or number, where the file leaves that open.
    :param units: of the columns, where it does not say them.
    :param how: whatever else has to be said of the file; columns and units are short for its.
    :param joint: in a bag; None: the first whose name ends in ``_slider``, or the only one.
    :param origin_ns: time that the stamps of a bag count from; None: its first message.
    :raises MeasurementError: a table cannot be read.
    :raises BagError: a bag cannot be read, or has no such joint.
    """
    how = how or Reading()
    how = replace(how, columns=columns or how.columns, units=units or how.units)
    if is_bag(path) and (is_foreign_bag(path) or how.columns):
        return _load_foreign_bag(path, joint, origin_ns, how)
    if is_bag(path):
        return _load_bag(path, joint, origin_ns)
    return LoadedMotion(read_measurement(path, how=how))


def _load_foreign_bag(
    path: Path, joint: str | None, origin_ns: int | None, how: Reading
) -> LoadedMotion:
    try:
        table, start_ns = read_bag(path)
        if not how.columns:
            how = replace(how, columns=joint_columns(table, joint, (_SLIDER, _PIEZO)))
        motion = motion_of(table, path.name, how)
    except MeasurementError as error:
        raise MeasurementError(f"{path}: {error}") from None
    except OSError as error:
        raise MeasurementError(f"cannot read {path}: {error.strerror or error}") from None
    first_ns = start_ns + round(1e9 * motion.t[0])
    if origin_ns is None:
        origin_ns = first_ns
    shift = 1e-9 * (first_ns - origin_ns)
    return LoadedMotion(replace(motion, t=motion.t - motion.t[0] + shift), origin_ns)


def _load_bag(path: Path, joint: str | None, origin_ns: int | None) -> LoadedMotion:
    stamps: list[int] = []
    positions: list[float] = []
    deflections: list[float] = []
    names: set[str] = set()
    with open_bag(path) as bag:
        topics = [name for name, topic in bag.topics.items() if topic.type == _JOINT_STATE]
        if not topics:
            raise BagError(f"{path} holds no topic of type {_JOINT_STATE}; record joint_states")
        # A topic that nothing came on has no definition to decode by.
        decoders = {name: decoder_for(bag.topics[name]) for name in topics if bag.counts[name]}
        for message in bag.messages(topics):
            state = decoders[message.topic](message.data)
            names.update(state.name)
            if joint is None:
                joint = next((name for name in state.name if name.endswith(_SLIDER)), None)
            wanted = joint or (state.name[0] if len(state.name) == 1 else None)
            if wanted is None or wanted not in state.name or len(state.position) != len(state.name):
                continue
            stamps.append(nanoseconds(state.header.stamp))
            positions.append(state.position[state.name.index(wanted)])
            piezo = wanted.removesuffix(_SLIDER) + _PIEZO
            if piezo in state.name:
                deflections.append(state.position[state.name.index(piezo)])
        parameters, version = _axis_of(bag, joint)
    if len(stamps) < 16:
        raise BagError(
            f"{path} has {len(stamps)} positions of the joint {joint or '(none chosen)'}; at "
            "least 16 are needed; choose with --joint, there are: "
            f"{', '.join(sorted(names)) or 'none'}"
        )
    times, first = np.unique(np.array(stamps, dtype=np.int64), return_index=True)
    origin = int(times[0]) if origin_ns is None else origin_ns
    u = np.array(deflections)[first] if len(deflections) == len(stamps) else None
    x = np.array(positions)[first]
    if not np.isfinite(x).all():
        raise BagError(f"{path}: joint {joint} has positions that are not numbers; leave them out")
    t = np.asarray(1e-9 * (times - origin), dtype=np.float64)
    return LoadedMotion(Motion(path.name, t, x, u=u), origin, parameters, version)


def _axis_of(bag: BagReader, joint: str | None) -> tuple[dict[str, Value] | None, str | None]:
    """Return parameters and version of the axis with a joint, from the event it starts with."""
    for texts in recorded_axes(bag).values():
        if f"{texts.get('axis_name')}{_SLIDER}" == joint:
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
