# SPDX-License-Identifier: Apache-2.0
"""The JSON interface of an attocube AMC, as its maker's and other public drivers speak it.

Methods, parameters and units: attocube's AMC-APIs (python/) and Diamond's EPICS driver amc100.
Positions in nm, voltages in mV, frequencies in mHz; axes are numbered from 0 on.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable
from typing import Any, ClassVar

from stickslip_ros.axis import Axis
from stickslip_ros.emulator.controller import (
    Channel,
    Controller,
    Dialogue,
    Lines,
    Reasons,
    Refused,
    Request,
    require,
    stored,
)
from stickslip_ros.version import __version__

MOST_VOLTS, LEAST_HERTZ, MOST_HERTZ = 60.0, 1.0, 5000.0
_AXES = 3  # that answers about all axes list
#: Errors of a method, chosen here: the first value of its result; 0 is none.
ERRORS = {
    1: "Value out of range",
    2: "Output not enabled",
    3: "No reference mark",
    4: "Not possible in this state",
}
_RANGE, _OUTPUT_OFF, _NO_REFERENCE, _STATE = ERRORS
#: Errors of JSON-RPC
_BAD, _NO_REQUEST = (-32602, "Invalid params"), (-32600, "Invalid Request")
#: Settings that are stored and reported, without an effect on the motion.
_SETTINGS: dict[str, bool | int] = {
    "control.ControlAutoReset": False,
    "control.ControlReferenceAutoUpdate": False,
    "control.SensorEnabled": True,
    "move.ControlEotOutputDeactive": False,
}
_TOKEN = re.compile(rb'"(?:[^"\\\n]|\\.)*("?)|[{}\n]')  # of a string: its last quote


class Objects(Lines):
    """Cuts a stream into JSON objects, which need nothing between them; a line feed ends all."""

    def __init__(self) -> None:
        """Limit objects to the length of a line."""
        super().__init__()
        self._depth = self._seen = 0  # of the kept bytes: braces open at their end, bytes searched

    def take(self, data: bytes) -> list[bytes | None]:
        """Return the objects that end in the data, None for each that was too long."""
        text, found = self._kept + data, list[bytes | None]()
        begin, depth, seen = 0, self._depth, self._seen
        for token in _TOKEN.finditer(text, self._seen):
            one = token[0]
            if token[1] == b"" and b"\n" not in text[token.end() : token.end() + 2]:
                break  # the string goes on
            seen = token.end()
            depth += {b"{": 1, b"}": -1}.get(one, 0)
            if one == b"\n" or (one == b"}" and depth <= 0):
                whole = text[begin:seen].strip()
                if self._too_long or len(whole) > self._longest:
                    found.append(None)
                elif whole:
                    found.append(whole)
                begin, depth, self._too_long = seen, 0, False
        self._kept, self._seen, self._depth = text[begin:], seen - begin, depth
        if len(self._kept) > self._longest:
            self._kept, self._seen, self._too_long = b"", 0, True
        return found


class Actor(Channel):
    """An axis with its output, which has to be enabled before it moves."""

    most_volts: ClassVar = MOST_VOLTS
    first_settings = _SETTINGS

    def __init__(self, axis: Axis) -> None:
        """Start with the output disabled, in open loop."""
        super().__init__(axis)
        self.output = self.loop = False
        self.jog = 0  #: sign of the endless motion that is wanted
        self.goal = 0.0  #: of the closed loop, m
        self.steps, self.target_range = 1, 100  #: of performNSteps; nm

    def tick(self) -> None:
        """Do nothing: a target is held until it is given up."""

    def drive(self) -> None:
        """Do what is wanted, if the output is enabled; stop otherwise."""
        if self.output and self.loop:
            self.go_to(self.goal, math.inf)
        elif self.output and self.jog:
            self.axis.command_jog(math.copysign(self.axis.status.frequency, self.jog))
        else:
            self.axis.stop()

    def enable(self, on: bool) -> None:
        """Switch the output; taking it away stops the axis, giving it clears a fault."""
        if on and self.locked:
            self.axis.reset()
        self.output = on
        self.drive()

    def close_loop(self, on: bool) -> None:
        """Approach and hold the target, or end that."""
        self.loop, self.jog = on, 0
        self.drive()

    def set_goal(self, nm: float) -> None:
        """Set the target (nm), which the closed loop goes to if it is on."""
        self.goal = 1e-9 * nm
        if self.loop:
            self.drive()

    def run(self, sign: int, on: bool) -> None:
        """Move without end, or stop whatever moves."""
        self.loop, self.jog = False, sign if on else 0
        self.drive()

    def step_by(self, backward: bool, steps: int) -> None:
        """Run steps."""
        require(self.output, _OUTPUT_OFF)
        require(1 <= steps < 2**31, _RANGE)
        self.loop, self.jog = False, 0
        self.axis.command_steps(-steps if backward else steps)

    @property
    def nm(self) -> float:
        """Measured position, nm."""
        return round(1e9 * self.position, 3)

    @property
    def motion(self) -> int:
        """2 if a motion is wanted while the output is disabled, 1 if it moves, 0 at rest."""
        return 2 * (not self.output and (self.loop or self.jog != 0)) or int(self.moving)

    @property
    def in_range(self) -> bool:
        """Whether the position is within the range of the target."""
        return abs(self.position - self.goal) <= 1e-9 * self.target_range

    def end(self, *sides: str) -> bool:
        """Return whether the axis is held by one of these ends of its travel."""
        return self.axis.status.held_at in sides

    @property
    def text(self) -> str:
        """The state in words."""
        for said, holds in (
            ("output not enabled", not self.output),
            ("moving", self.moving),
            ("backward limit reached", self.end("low")),
            ("forward limit reached", self.end("high")),
            ("in target range", self.loop and self.in_range),
        ):
            if holds:
                return said
        return "idle"

    def set_volts(self, millivolts: float) -> None:
        """Set the amplitude (mV)."""
        require(0 < millivolts <= 1e3 * MOST_VOLTS, _RANGE)
        self.axis.command_amplitude(1e-3 * millivolts)

    def set_hertz(self, millihertz: float) -> None:
        """Set the frequency (mHz)."""
        require(1e3 * LEAST_HERTZ <= millihertz <= 1e3 * MOST_HERTZ, _RANGE)
        self.axis.command_frequency(1e-3 * millihertz)

    def set_level(self, millivolts: float) -> None:
        """Set the dc voltage of the output (mV)."""
        require(0 <= millivolts <= 1e3 * MOST_VOLTS, _RANGE)
        self.loop, self.jog = False, 0
        self.axis.command_scan(1e-3 * millivolts)

    @property
    def level(self) -> int:
        """Dc voltage of the output, mV."""
        return round(1e3 * self.axis.status.scan_level)


class AmcDialogue(Dialogue):
    """One client; each request is answered with a line."""

    reasons = Reasons((-32601, "Method not found"), _BAD, _BAD, _BAD, _BAD, _STATE)

    def cutter(self) -> Lines:
        """Cut requests, which no line feed has to end."""
        return Objects()

    def answer(self, line: bytes | None) -> bytes:
        """Return the answer to a request: its result, or the error of JSON-RPC."""
        number, said = None, dict[str, Any]()
        try:
            request = json.loads(line or b"")
            require(isinstance(request, dict), _NO_REQUEST)
            number = request.get("id")
            require(isinstance(request.get("method"), str), _NO_REQUEST)
            said = {"result": self._result(request)}
        except Refused as refused:
            code, message = refused.reason
            said = {"error": {"code": code, "message": message}}
        except (ValueError, RecursionError):
            said = {"error": {"code": -32700, "message": "Parse error"}}
        return json.dumps({"jsonrpc": "2.0", **said, "id": number}).encode() + b"\r\n"

    def _result(self, request: dict[str, Any]) -> list[Any]:
        name = request["method"].removeprefix("com.attocube.").removeprefix("amc.")
        values = request.get("params") or []
        require(isinstance(values, list), _BAD)
        command, whose = OF_CONTROLLER.get(name), self.controller
        if not command and (command := OF_AXIS.get(name)):
            axis, *values = values or [None]
            whose = self.channel(int(axis) if axis in range(_AXES) else -1)
        try:
            found = self.carry_out(command, whose, values)
        except Refused as refused:
            if isinstance(refused.reason, tuple):  # an error of JSON-RPC
                raise
            return [refused.reason]
        if isinstance(found, str) and name.startswith("system.") and "api" not in request:
            return [found]  # older drivers expect the text alone
        return [0, *(found if isinstance(found, list) else [] if found is None else [found])]

    def read(self, value: Any) -> Any:
        """Return an argument that is a number. Raises Refused."""
        require(isinstance(value, int | float) and abs(value) < 2**63, _BAD)
        return value


class Amc(Controller):
    """The controller: up to three axes."""

    channel = Actor
    dialogue = AmcDialogue

    def of_all(self, read: Callable[[Actor], Any]) -> list[Any]:
        """Return what is read of each of three axes, 0 for those that there are not."""
        found = [read(actor) for actor in self.channels]
        return found + [0] * (_AXES - len(found))

    def position_all(self, *values: float) -> list[Any]:
        """Set the targets of some axes, and return references and positions of all."""
        for actor, on, target in zip(self.channels, values[:_AXES], values[_AXES:], strict=False):
            if on:
                actor.set_goal(target)
        return [False] * _AXES + [0] * _AXES + self.of_all(lambda actor: actor.nm)


OF_AXIS: dict[str, Request] = {
    "control.setControlOutput": Request(lambda a, on: a.enable(bool(on)), 1),
    "control.getControlOutput": Request(lambda a: a.output),
    "control.setControlAmplitude": Request(Actor.set_volts, 1),
    "control.getControlAmplitude": Request(lambda a: round(1e3 * a.axis.status.amplitude)),
    "control.setControlFrequency": Request(Actor.set_hertz, 1),
    "control.getControlFrequency": Request(lambda a: round(1e3 * a.axis.status.frequency)),
    "control.setControlMove": Request(lambda a, on: a.close_loop(bool(on)), 1),
    "control.getControlMove": Request(lambda a: a.loop),
    "control.setControlTargetRange": Request(lambda a, nm: setattr(a, "target_range", nm), 1),
    "control.getControlTargetRange": Request(lambda a: a.target_range),
    "control.setControlFixOutputVoltage": Request(Actor.set_level, 1),
    "control.getControlFixOutputVoltage": Request(lambda a: a.level),
    "control.getCurrentOutputVoltage": Request(lambda a: a.level),
    "control.setReset": Request(lambda a: a.set_position(0.0)),
    "control.searchReferencePosition": Request(lambda a: require(False, _NO_REFERENCE)),
    "control.getReferencePosition": Request(lambda a: 0),
    "control.getActorName": Request(lambda a: f"SIM-{a.axis.parameters.node.axis_name}"),
    "control.getActorType": Request(lambda a: 0),
    "move.setSingleStep": Request(lambda a, backward: a.step_by(backward, 1), 1),
    "move.setNSteps": Request(lambda a, backward, steps: a.step_by(backward, int(steps)), 2),
    "move.writeNSteps": Request(lambda a, steps: setattr(a, "steps", int(steps)), 1),
    "move.performNSteps": Request(lambda a, backward: a.step_by(backward, a.steps), 1),
    "move.getNSteps": Request(lambda a: a.steps),
    "move.setControlContinuousFwd": Request(lambda a, on: a.run(1, bool(on)), 1),
    "move.getControlContinuousFwd": Request(lambda a: a.jog > 0),
    "move.setControlContinuousBkwd": Request(lambda a, on: a.run(-1, bool(on)), 1),
    "move.getControlContinuousBkwd": Request(lambda a: a.jog < 0),
    "move.setControlTargetPosition": Request(Actor.set_goal, 1),
    "move.getControlTargetPosition": Request(lambda a: round(1e9 * a.goal, 3)),
    "move.moveReference": Request(lambda a: require(False, _NO_REFERENCE)),
    "move.getPosition": Request(lambda a: a.nm),
    "status.getStatusConnected": Request(lambda a: True),
    "status.getStatusReference": Request(lambda a: False),
    "status.getStatusMoving": Request(lambda a: a.motion),
    "status.getStatusEotFwd": Request(lambda a: a.end("high")),
    "status.getStatusEotBkwd": Request(lambda a: a.end("low")),
    "status.getStatusEot": Request(lambda a: a.end("high", "low")),
    "status.getStatusTargetRange": Request(lambda a: a.in_range),
    "status.getOlStatus": Request(lambda a: 0),
    "status.getFullCombinedStatus": Request(lambda a: a.text),
}
for _name, _first in _SETTINGS.items():
    _room, _, _rest = _name.partition(".")
    OF_AXIS[f"{_room}.set{_rest}"], OF_AXIS[f"{_room}.get{_rest}"] = stored(_name, type(_first))

OF_CONTROLLER: dict[str, Request] = {
    "control.MultiAxisPositioning": Request(Amc.position_all, 2 * _AXES),
    "control.getPositionsAndVoltages": Request(
        lambda c: c.of_all(lambda a: a.nm) + c.of_all(lambda a: a.level)
    ),
    "control.getStatusMovingAllAxes": Request(lambda c: c.of_all(lambda a: a.motion)),
    "description.getDeviceType": Request(lambda c: "AMC100/NUM/PRO"),
    "description.getFeaturesActivated": Request(lambda c: "Closed loop Operation, Pro"),
    "getLockStatus": Request(lambda c: [False, True]),
    "system.errorNumberToString": Request(
        lambda c, language, number: ERRORS.get(number, "Unknown error") if number else "Ok", 2
    ),
    "system.errorNumberToRecommendation": Request(lambda c, language, number: 0, 2),
    "system.getDeviceName": Request(lambda c: "stickslip_ros"),
    "system.getFirmwareVersion": Request(lambda c: __version__),
    "system.getSerialNumber": Request(lambda c: "SIM-0"),
}
