# SPDX-License-Identifier: Apache-2.0
"""Runs an axis once more from its events: the same commands at the same simulation times.

What a run needs is in its events: "start" holds every parameter, each applied command what it was
and when. The axis starts at rest, reads no clock and draws its noise from a seed, so the same
version on the same machine gives every state again, to the last bit.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.axis.device import Axis, CommandRefused
from stickslip_ros.axis.events import Event
from stickslip_ros.parameters import PARAMETERS, ParameterError, Values, check

#: The first event of every axis
START = "start"


class NotRepeatable(ValueError):
    """The events do not hold what it takes to repeat the run; the message says what is missing."""


def details_from_text(texts: Mapping[str, str]) -> dict[str, Any]:
    """Return details of an event from the texts that messages carry.

    Parameters are read as the table has them, all else as JSON, and as a text if it is none.
    """
    details: dict[str, Any] = {}
    for name, text in texts.items():
        if name in PARAMETERS:
            details[name] = PARAMETERS[name].parse(text)
            continue
        try:
            details[name] = json.loads(text.lower() if text in ("True", "False") else text)
        except json.JSONDecodeError:
            details[name] = text
    return details


def start_of(events: Sequence[Event]) -> tuple[Values, str]:
    """Return the parameters at the start of a run and the version that it ran with."""
    first = events[0] if events else None
    if first is None or first.name != START:
        missing = "no event at all" if first is None else f"a first event {first.name!r}"
        raise NotRepeatable(
            f"there is {missing}, not the start of the axis: record its events from the start on, "
            "or within its last thousand events"
        )
    given = {name: value for name, value in first.details.items() if name in PARAMETERS}
    return given, str(first.details.get("version", ""))


def resimulate(
    events: Sequence[Event], times: NDArray[np.int64], changes: Mapping[str, Any] | None = None
) -> Iterator[Axis]:
    """Yield the axis at each time (ns of simulation, rising), run anew from its events.

    A state at the time of a command is the one before the command. With changes of parameters, in
    force from the start and laid over every later change, the run is a different one: commands
    that it refuses are left out. Raises NotRepeatable without changes if a command is refused, or
    if the events do not begin with the start; ParameterError for bad changes.
    """
    given, _ = start_of(events)
    changes = check_changes(changes or {})
    try:
        axis = Axis(check({**given, **changes}))
    except ParameterError as error:
        if changes:
            raise
        raise NotRepeatable(f"this version refuses the parameters of the run: {error}") from None
    commands = [event for event in events[1:] if event.outcome == "applied"]
    done = 0
    for time in times:
        t = int(time) * 1e-9
        while done < len(commands) and commands[done].time < t:
            _repeat(axis, commands[done], changes)
            done += 1
        axis.advance(t)
        axis.take_events()
        yield axis


def check_changes(changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return the changes, each one checked against the table; ParameterError if one is bad."""
    checked = check(changes)
    return {name: checked[name] for name in changes}


def _repeat(axis: Axis, command: Event, changes: Mapping[str, Any]) -> None:
    axis.advance(command.time)
    details = {**command.details, **{n: v for n, v in changes.items() if n in command.details}}
    try:
        axis.repeat(command.name, details)
    except CommandRefused as refusal:
        if not changes:
            raise NotRepeatable(
                f"the command {command.name!r} at {command.time:.9g} s was applied in the run, "
                f"but is refused now: {refusal}"
            ) from None
