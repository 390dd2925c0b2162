# SPDX-License-Identifier: Apache-2.0
"""Commands and readings of an axis from a table or a bag, in the order in which they came."""

from __future__ import annotations

import csv
import heapq
import io
import math
from collections import deque
from dataclasses import replace
from operator import itemgetter
from pathlib import Path

import numpy as np

from stickslip_ros.axis.commands import COMMANDS
from stickslip_ros.axis.events import START, Event
from stickslip_ros.base.arrays import Array
from stickslip_ros.base.opening import open_regular
from stickslip_ros.measurement.bags.load_motion import is_bag, load_motion
from stickslip_ros.measurement.reading import Reading
from stickslip_ros.measurement.reading.choice import POSITION, TIME, Quantity, choose
from stickslip_ros.measurement.reading.formats import naming, open_table
from stickslip_ros.measurement.twin.own_sensor import OwnSensor
from stickslip_ros.measurement.twin.settings import TwinError
from stickslip_ros.measurement.twin.timeline import TwinCommand
from stickslip_ros.recordings import open_bag
from stickslip_ros.recordings.runs import recorded_runs

Log = list[TwinCommand | tuple[float, float]]

#: Commands whose cycles the twin knows, and others that begin none; it knows nothing of the cycles
#: of all that move the axis beside these
KNOWN, _NO_CYCLES = ("steps", "jog", "amplitude", "frequency", "stop"), ("reset", "enable")
UNKNOWN = tuple(
    name for name, one in COMMANDS.items() if one.moves and name not in (*KNOWN, *_NO_CYCLES)
)

#: Bytes of a file of commands
_LARGEST = 100_000_000
#: Columns with the commands: a number of steps in a row is a command given then, 0 is none
_COLUMNS = [
    Quantity(name, f"{name} commanded", "frequency", (name,), "Hz", required=False, default="Hz")
    for name in ("amplitude", "frequency", "steps")
]


def commands_of(event: Event, t: float) -> list[TwinCommand]:
    """Return the commands (at t, s) that an event of an axis stands for."""
    if event.name == START:
        drive = {name: event.details.get(name) for name in ("amplitude", "frequency")}
        known = [TwinCommand(t, name, float(one)) for name, one in drive.items() if one]
        return [TwinCommand(t, "start"), *known]
    if event.outcome == "applied" and event.name in KNOWN:
        return [TwinCommand(t, event.name, float(event.details.get("value", 0.0)))]
    if event.outcome == "applied" and event.name in UNKNOWN:
        return [TwinCommand(t, event.name)]
    ends = event.outcome in ("hit", "fault") or (event.name, event.outcome) == ("scan", "finished")
    if ends or (event.name == "enable" and not event.details.get("value", True)):
        return [TwinCommand(t, "stop")]
    return []


def read_log(
    path: Path, how: Reading | None = None, drive: Path | None = None, joint: str | None = None
) -> Log:
    """Read a log from a bag, or from a table with columns of commands or a file of them beside.

    how says how columns are read; joint is that of a bag. Raises TwinError where there are no
    commands, MeasurementError and BagError.
    """
    how = how or Reading()
    if not is_bag(path):
        return _of_table(path, how, drive)
    found = load_motion(path, how, joint)
    motion, first = found.motion, found.origin_ns or 0
    if drive is not None:
        return _merged(_of_file(drive), motion.t, motion.x)
    with open_bag(path) as bag:
        runs = recorded_runs(bag)
    of_axis = [run for run in runs if run.node == (found.node or runs[0].node)]
    # Times count from what is oldest, as they do in the node: so they have the same bits.
    origin = min(first, *(run.start_ns for run in of_axis))
    events = [(event_ns(run.start_ns, event), event) for run in of_axis for event in run.events]
    stamps = (first + np.rint(1e9 * motion.t).astype(np.int64)).tolist()
    log, sensor = Log(), OwnSensor()
    readings = zip(stamps, motion.x.tolist(), strict=True)
    for ns, what in heapq.merge(events, readings, key=itemgetter(0)):
        if isinstance(what, Event):
            sensor.hear(what, ns)
            log += commands_of(what, 1e-9 * (ns - origin))
        elif (taken := sensor.taken_ns(found.joint or "", ns)) is not None:
            log.append((1e-9 * (taken - origin), what))
    return log


def event_ns(start_ns: int, event: Event) -> int:
    """Return the time (ns) of an event of an axis whose simulated time was 0 at another."""
    return start_ns + round(1e9 * event.time)


def _of_table(path: Path, how: Reading, drive: Path | None) -> Log:
    """Return the rows as they stand: the twin reports late, doubled and empty ones."""
    with naming(path):
        table, plain = open_table(path, how.decimal), {one.key: "Hz" for one in _COLUMNS}
        plainly = replace(how, units={**plain, **how.units})  # V and Hz, whatever the unit says
        chosen, _ = choose(table, (TIME, POSITION, *_COLUMNS), plainly)
        loaded = zip(chosen.items(), table.load(list(chosen.values())).values, strict=True)
        values = {name: column.factor * (one + column.origin) for (name, column), one in loaded}
    x = values["x"] / math.cos(how.angle)
    t = values["t"] if "t" in values else np.arange(len(x)) / (how.rate or 1.0)
    if drive is not None:
        return _merged(_of_file(drive), t, x)
    if "steps" not in values:
        raise TwinError(
            f"{path} has no column steps; add the columns steps, amplitude (V) and frequency (Hz) "
            "with the commands, or give them with --drive"
        )
    log, before = Log(), dict[str, float]()
    for k, now in enumerate(t.tolist()):
        for name in (one.key for one in _COLUMNS if one.key in values):
            value = float(values[name][k])
            if value and not math.isnan(value) and (name == "steps" or value != before.get(name)):
                log.append(TwinCommand(now, name, value))
                before[name] = value
        log.append((now, float(x[k])))
    return log


def _of_file(path: Path) -> list[TwinCommand]:
    """Read commands from a table of time (s), command and value. Raises TwinError."""
    found = []
    with naming(path), open_regular(path, _LARGEST) as file:
        text = file.read().decode(errors="replace")
    for number, row in enumerate(csv.DictReader(io.StringIO(text)), 2):
        try:
            name = row["command"].strip()
            if name not in (*KNOWN, *UNKNOWN, "start"):
                raise ValueError(f"no command {name!r}; known: {', '.join((*KNOWN, *UNKNOWN))}")
            found.append(TwinCommand(float(row["time"]), name, float(row.get("value") or 0.0)))
        except (KeyError, ValueError, AttributeError) as error:
            raise TwinError(
                f"{path}, line {number}: {error}; write a table with the columns time (s), "
                "command and value, such as 0.5,steps,100"
            ) from None
    return sorted(found, key=lambda command: command.t)


def _merged(commands: list[TwinCommand], times: Array, positions: Array) -> Log:
    """Return commands among readings, each before the first reading that is not older."""
    log, waiting, latest = Log(), deque(commands), -math.inf
    for t, x in zip(times.tolist(), positions.tolist(), strict=True):
        latest = max(latest, t) if math.isfinite(t) else latest
        while waiting and waiting[0].t <= latest:
            log.append(waiting.popleft())
        log.append((t, x))
    return log
