# SPDX-License-Identifier: Apache-2.0
"""Events of an axis, refusals of commands, and both as texts.

Messages and bags carry events as texts, without loss. Files that parameters name belong to a run as
the parameters do: an event that sets parameters holds the digest of each file that they use.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Collection, Iterable, Mapping, Sequence, Sized
from dataclasses import dataclass, field
from itertools import groupby, islice
from operator import itemgetter
from pathlib import Path
from typing import Any

from stickslip_ros.base.errors import StickslipError
from stickslip_ros.physics.parameters import PARAMETERS, ParameterError, Parameters
from stickslip_ros.physics.parameters.bounded_files import read_bytes
from stickslip_ros.physics.parameters.row import file_names

#: Keys besides those of the details, and that of the running number, with which a loss is noticed
KEYS = _TIME, _NAME, _OUTCOME = "time (s)", "event", "outcome"
NUMBER = "number"
#: Events that no command makes: the first one of every axis, a fault from outside, the end of a
#: step of time, and a fault on demand that began or ended
START, TRIP, STEP_OF_TIME, INJECTED = "start", "trip", "step of time", "injected fault"
WARNED = "warned"  #: outcome of what is carried out, but not as it was meant
#: The event of one set point, and of many in the log
_SET_POINT, _SET_POINTS = "joint_command", "joint_commands"
#: Characters of a text, and items of a list, that the event of a refusal holds
LONGEST_TEXT, _MOST_ITEMS = 400, 16
_DIGEST = "_sha256"  # end of the names of details that are digests of files


class CommandRefused(StickslipError, ValueError):
    """A command that the axis does not carry out; the message names the value and the limit."""


class NotRepeatable(StickslipError, ValueError):
    """The run cannot be repeated from its events; the message says what is missing."""


@dataclass(frozen=True)
class Event:
    """Something a later run has to know to repeat this one, or a user to understand it."""

    time: float  #: s since the start of the simulation
    name: str  #: its subject, such as "steps"
    outcome: str  #: "applied", "refused", "finished", "warned", "hit" or "fault"
    details: dict[str, Any] = field(default_factory=dict)
    #: Of the events of the axis, from 1 on; 0: not counted, as set points and those of 1.x
    number: int = field(default=0, compare=False)

    @property
    def level(self) -> int:
        """The level of the DiagnosticStatus that carries it: 0 OK, 1 WARN, 2 ERROR."""
        return {"applied": 0, "finished": 0, "fault": 2}.get(self.outcome, 1)

    @classmethod
    def of(cls, texts: Mapping[str, str]) -> Event | None:
        """Return the event that `event_texts` made the texts of; None if they are none.

        Parameters are read as the table has them, all else as JSON, and as a text if it is none.
        """
        if not set(KEYS) <= set(texts):
            return None
        rest = dict(texts)
        number, time = int(rest.pop(NUMBER, 0)), float(rest.pop(_TIME))
        details = {name: _value(name, text) for name, text in rest.items() if name not in KEYS}
        return cls(time, texts[_NAME], texts[_OUTCOME], details, number)


def event_texts(event: Event) -> dict[str, str]:
    """Return time, name, outcome, number and details of an event as texts by key."""
    named: dict[str, Any] = {_TIME: event.time, _NAME: event.name, _OUTCOME: event.outcome}
    named |= {NUMBER: event.number} if event.number else {}
    return {key: value_text(value) for key, value in {**named, **event.details}.items()}


def is_set_point(event: Event) -> bool:
    """Return whether an event is a set point of a controller that the axis follows."""
    return event.name == _SET_POINT and event.outcome == "applied"


def pack_set_points(set_points: Sequence[Event]) -> list[Event]:
    """Combine set points into events, each with many of one joint and interface, in order."""
    packed = []
    kind = itemgetter("joint", "interface")
    for (joint, interface), same in groupby(set_points, lambda event: kind(event.details)):
        run = list(same)
        details: dict[str, Any] = {"joint": joint, "interface": interface}
        details["times"] = [event.time for event in run]
        details["values"] = [event.details["value"] for event in run]
        packed.append(Event(run[0].time, _SET_POINTS, "applied", details))
    return packed


def unpack_set_points(event: Event) -> list[Event]:
    """Return the set points in an event of `pack_set_points`; any other event unchanged."""
    if event.name != _SET_POINTS:
        return [event]
    same = {name: event.details[name] for name in ("joint", "interface")}
    return [
        Event(time, _SET_POINT, "applied", {**same, "value": value})
        for time, value in zip(event.details["times"], event.details["values"], strict=True)
    ]


def value_text(value: Any) -> str:
    """Return a value as a text; floats in full, so that none is rounded; None as nan."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "nan"
    if isinstance(value, list | tuple | dict):
        return json.dumps(value, default=list)  # arrays, which parameters of ROS may be
    return repr(value) if isinstance(value, float) else str(value)


def shorten(value: Any) -> Any:
    """Return a value with long texts and lists cut, for events that nobody repeats.

    A refused command may hold megabytes, and events are kept for those who join late.
    """
    if isinstance(value, str):
        if len(value) <= LONGEST_TEXT:
            return value
        half = LONGEST_TEXT // 2
        return f"{value[:half]} ... ({len(value)} characters) ... {value[-half:]}"
    if isinstance(value, Mapping):
        return {shorten(key): shorten(one) for key, one in islice(value.items(), _MOST_ITEMS)}
    if isinstance(value, Iterable) and isinstance(value, Sized):
        kept = [shorten(item) for item in islice(value, _MOST_ITEMS)]
        left = len(value) - len(kept)
        return [*kept, f"and {left} more"] if left > 0 else kept
    return value


def _value(name: str, text: str) -> Any:
    if name in PARAMETERS:
        return PARAMETERS[name].parse(text)
    if is_digest(name):
        return text
    try:
        return json.loads(text.lower() if text in ("True", "False") else text)
    except json.JSONDecodeError:
        return text
    except RecursionError:
        raise ValueError(f"{name} is nested too deep") from None


# -- files that parameters name


def files_of(p: Parameters) -> dict[str, Path]:
    """Return the files that parameters use, by the parameter that names them."""
    files = {}
    if p.drive.waveform == "table" and p.drive.waveform_table is not None:
        files["waveform_table"] = Path(p.drive.waveform_table)
    if p.actuator.actuator == "hysteresis" and p.actuator.hysteresis_file is not None:
        files["hysteresis_file"] = Path(p.actuator.hysteresis_file)
    return files


def digests_of(p: Parameters) -> dict[str, str]:
    """Return the SHA-256 of the files that parameters use, by detail name; ParameterError."""
    return {f"{name}{_DIGEST}": _digest(name, path) for name, path in files_of(p).items()}


def is_digest(name: str) -> bool:
    """Return whether a detail of an event is the digest of a file."""
    return name.endswith(_DIGEST)


def check_files(p: Parameters, details: Mapping[str, object], but: Collection[str]) -> None:
    """Raise ParameterError if a file that parameters use is not the one of the details.

    Those of the parameters ``but`` may be others.
    """
    for name, path in files_of(p).items():
        noted = None if name in but else details.get(f"{name}{_DIGEST}")
        if noted and noted != (found := _digest(name, path)):
            raise ParameterError(
                f"{name} {path} has changed since the run: its SHA-256 is {found}, that of the "
                f"run was {noted}; restore the file of the run"
            )


def check_place(p: Parameters, changes: Mapping[str, object]) -> None:
    """Raise ParameterError if a change that comes from outside names a file it must not.

    Whoever starts an axis may name any file; others only those in ``data_directory``.
    """
    for name in file_names(PARAMETERS):
        path = changes.get(name)
        if not path or path == p.value(name):
            continue
        folder = p.node.data_directory
        if folder is None:
            raise ParameterError(
                f"{name} names a file, and none may be named while the axis runs: start it with "
                "data_directory, the folder of such files"
            )
        try:
            inside = Path(str(path)).resolve().is_relative_to(Path(folder).resolve())
        except (OSError, ValueError, RuntimeError):  # not a path, or links in a circle
            inside = False
        if not inside:
            raise ParameterError(f"{name} is outside data_directory, {folder}: put the file there")


def _digest(name: str, path: Path) -> str:
    try:
        return hashlib.sha256(read_bytes(path)).hexdigest()
    except ParameterError as error:
        raise ParameterError(f"{name}: {error}; put the file in its place") from None
