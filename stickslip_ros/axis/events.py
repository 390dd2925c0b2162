# SPDX-License-Identifier: Apache-2.0
"""Events of an axis, refusals of commands, and both as texts.

Messages and bags carry events as texts, without loss.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence, Sized
from dataclasses import dataclass, field
from itertools import groupby, islice
from operator import itemgetter
from typing import Any

from stickslip_ros.base.errors import StickslipError
from stickslip_ros.physics.parameters import PARAMETERS
from stickslip_ros.physics.parameters.named_files import is_digest

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
