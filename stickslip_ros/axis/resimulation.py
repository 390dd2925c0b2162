# SPDX-License-Identifier: Apache-2.0
"""Runs an axis again from its events: the same commands at the same simulation times.

The event "start" holds every parameter, and each applied command its arguments and time. Files that
parameters name have to exist with the same content. The axis starts at rest, reads no clock and
draws its noise from a seed, so the same version gives the same states to the last bit wherever
`model.arithmetic` has the same digest.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from stickslip_ros.axis.axis import Axis
from stickslip_ros.axis.commands import COMMANDS
from stickslip_ros.axis.events import START, TRIP, CommandRefused, Event, NotRepeatable
from stickslip_ros.physics.model.versions import ModelChange, changes_since
from stickslip_ros.physics.parameters import PARAMETERS, ParameterError, Parameters, parameter
from stickslip_ros.physics.parameters.named_files import check_files

#: Characters of a text from a recording that an error shows: names of events are shorter
_SHOWN = 40
_REFUSED = "this version refuses the parameters of the run"


def start_of(events: Sequence[Event]) -> tuple[dict[str, Any], str, str]:
    """Return the parameters at the start of a run, and the version and arithmetic of its axis.

    The arithmetic is the digest of `model.arithmetic`, empty in recordings before 2.0.0.
    """
    first = events[0] if events else None
    if first is None or first.name != START:
        found = "there are none" if first is None else f"they begin with {first.name!r}"
        raise NotRepeatable(
            f"the start of the axis is not among its events, {found}: record them from the start "
            "on, or within its last thousand messages with events"
        )
    given = {name: value for name, value in first.details.items() if name in PARAMETERS}
    version, arithmetic = (str(first.details.get(one, "")) for one in ("version", "arithmetic"))
    return given, version, arithmetic[:_SHOWN]


def parameters_of(
    events: Sequence[Event], changes: Mapping[str, Any] | None = None
) -> Iterator[tuple[Event, Parameters]]:
    """Yield the start and each change of parameters, with the full set in force from then on.

    changes: parameters that are laid over each. Raises NotRepeatable: this version refuses them.
    """
    p = Parameters()
    for event in events:
        if event.outcome == "applied" and event.name in (START, "parameters"):
            given = {name: v for name, v in event.details.items() if name in PARAMETERS}
            try:
                p = p.replace(**{**given, **(changes or {})})
            except ParameterError as error:
                raise NotRepeatable(f"{_REFUSED}: {error}") from None
            yield event, p


def model_changes(events: Sequence[Event]) -> tuple[int, list[ModelChange]]:
    """Return the model version of a recorded run, and the later changes that affect it."""
    version = events[0].details.get("model_version", 1) if events else 1  # the first noted none
    if type(version) is not int or version < 1:
        raise NotRepeatable(f"the run names a model that cannot be: {str(version)[:_SHOWN]!r}")
    touched = [change for _, p in parameters_of(events) for change in changes_since(version, p)]
    return version, list(dict.fromkeys(touched))


class Rerun:
    """An axis run anew from its events, to be asked for its state at rising times.

    With changes of parameters, in force from the start and laid over every later change, it is
    another run under the same commands; those that it refuses are left out and counted.
    """

    def __init__(self, events: Sequence[Event], changes: Mapping[str, Any] | None = None) -> None:
        """Set up the axis at its start.

        Raises NotRepeatable if the events do not begin with the start or a file that the run used
        is not there as it was, ParameterError for bad changes.
        """
        given = start_of(events)[0]
        self._changes = {name: parameter(name).check(v) for name, v in (changes or {}).items()}
        for event, p in parameters_of(events, self._changes):
            try:
                check_files(p, event.details, but=self._changes)
            except ParameterError as error:
                raise NotRepeatable(str(error)) from None
        try:
            self.axis = Axis({**given, **self._changes}, model_changes(events)[0])
        except ParameterError as error:
            if self._changes:
                raise
            raise NotRepeatable(f"{_REFUSED}: {error}") from None
        applied = [event for event in events[1:] if event.outcome == "applied"]
        self._commands = deque(_commands_of(applied, self._changes))
        self.left_out: list[str] = []  #: commands refused, each with the reason

    def advance(self, t: float) -> Axis:
        """Execute the commands before t (s), advance to t, return the axis.

        Commands at t itself follow the state at t. Raises NotRepeatable if a command is refused
        that was applied in the recording, unless parameters were changed.
        """
        while self._commands and self._commands[0][0] < t:
            time, name, arguments = self._commands[0]
            self.axis.advance(time)
            try:
                if name == TRIP:
                    self.axis.trip(*arguments)
                else:
                    self.axis.command(name, *arguments)
            except CommandRefused as refusal:
                what = f"{name!r} at {time:.9g} s: {refusal}"
                if not self._changes:
                    raise NotRepeatable(
                        f"a command that was applied in the run is refused now, {what}"
                    ) from None
                self.left_out.append(what)
            self._commands.popleft()
        self.axis.advance(t)
        return self.axis


def _commands_of(
    events: Sequence[Event], changes: Mapping[str, Any]
) -> Iterator[tuple[float, str, tuple[Any, ...]]]:
    """Yield time (s), name and arguments of the commands, with changes laid over parameters.

    Raises NotRepeatable for events that no axis can have noted: a bag can be anybody's.
    """
    before = 0.0
    for event in events:
        name, details = event.name, event.details
        arguments: tuple[Any, ...] | None = None
        try:
            if not before <= event.time < math.inf:
                raise ValueError("times begin at 0 and never run back")
            if name == TRIP and "reason" in details:
                arguments = (details["reason"],)
            elif name in COMMANDS:
                laid = {one: changes[one] for one in changes if one in details}
                arguments = COMMANDS[name].arguments_of({**details, **laid})
            elif name != START:
                raise ValueError("there is no such command")
        except ValueError as error:
            where = f"the event {name[:_SHOWN]!r} at {event.time:.9g} s"
            raise NotRepeatable(f"{where} does not come from an axis: {error}") from None
        before = event.time
        if arguments is not None:
            yield before, name, arguments
