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
    lacking,
    require,
    stored,
)
from stickslip_ros.version import __version__

MOST_VOLTS, LEAST_HERTZ, MOST_HERTZ = 60.0, 1.0, 5000.0
_AXES = 3  # that answers about all axes list
#: Errors of a method, the first value of its result; 0 is none. The maker's tests have 7 for an
#: axis that there is not, its library 10 for what was not bought; the others were chosen.
ERRORS = {
    2: "Output not enabled",
    3: "No reference",
    4: "Not possible in this state",
    7: "Parameter out of range",
    10: "Feature not available",
}
_OUTPUT_OFF, _NO_REFERENCE, _STATE, _RANGE, _LACKING = ERRORS
#: Errors of JSON-RPC
_BAD, _NO_REQUEST = (-32602, "Invalid params"), (-32600, "Invalid Request")
#: Settings that are stored and reported, without an effect on the motion.
_SETTINGS = {
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

    def want(self, loop: bool, jog: int) -> None:
        """Do what is wanted, if the output is enabled; stop otherwise. What is refused is not kept.

        loop: go to the target and hold it; jog: sign of a motion without end.
        """
        require(not (self.output and self.locked and (loop or jog)), _STATE)
        if self.output and loop:
            self.go_to(self.goal, math.inf)
        elif self.output and jog:
            self.axis.command("jog", math.copysign(self.axis.status.frequency, jog))
        else:
            self.axis.command("stop")
        self.loop, self.jog = loop, jog

    def enable(self, on: bool) -> None:
        """Switch the output; taking it away stops the axis, giving it clears a fault."""
        if on and self.locked:
            self.axis.command("reset")
        self.output = on
        self.want(self.loop, self.jog)

    def set_goal(self, nm: float) -> None:
        """Set the target (nm), which the closed loop goes to if it is on."""
        self.check_target(1e-9 * nm)
        if self.output and self.loop:
            self.go_to(1e-9 * nm, math.inf)
        self.goal = 1e-9 * nm

    def step_by(self, backward: bool, steps: int) -> None:
        """Run steps."""
        require(self.output, _OUTPUT_OFF)
        require(1 <= steps < 2**31, _RANGE)
        self.axis.command("steps", -steps if backward else steps)
        self.loop, self.jog = False, 0

    def set_steps(self, steps: int) -> None:
        """Set the number of steps that `performNSteps` runs."""
        require(1 <= steps < 2**31, _RANGE)
        self.steps = steps

    def set_target_range(self, nm: int) -> None:
        """Set the distance (nm) from the target within which it counts as reached."""
        require(0 <= nm < 2**31, _RANGE)
        self.target_range = nm

    def search(self) -> None:
        """Go to the reference mark and stop there."""
        require(self.output, _OUTPUT_OFF)
        self.find_reference(0.0, zero=bool(self.settings["control.ControlAutoReset"]))
        self.loop, self.jog = False, 0

    def go_to_reference(self) -> None:
        """Go to the mark again, once it is known where it is."""
        require(self.output, _OUTPUT_OFF)
        require(self.referenced, _NO_REFERENCE)
        self.go_to(-self._origin, 0.0)
        self.loop, self.jog = False, 0

    def mark(self) -> float:
        """Return the position of the reference mark, nm; 0 until it is known."""
        return 0.0 - round(1e9 * self._origin, 3) if self.referenced else 0

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
        self.axis.command("amplitude", 1e-3 * millivolts)

    def set_hertz(self, millihertz: float) -> None:
        """Set the frequency (mHz)."""
        require(1e3 * LEAST_HERTZ <= millihertz <= 1e3 * MOST_HERTZ, _RANGE)
        self.axis.command("frequency", 1e-3 * millihertz)

    def set_level(self, millivolts: float) -> None:
        """Set the dc voltage of the output (mV)."""
        require(0 <= millivolts <= 1e3 * MOST_VOLTS, _RANGE)
        self.axis.command("scan", 1e-3 * millivolts)
        self.loop, self.jog = False, 0

    @property
    def level(self) -> int:
        """Dc voltage of the output, mV."""
        return round(1e3 * self.axis.status.scan_level)


class AmcDialogue(Dialogue):
    """One client; each request is answered with a line."""

    reasons = Reasons((-32601, "Method not found"), _RANGE, _BAD, _BAD, _STATE, _RANGE)

    def cutter(self) -> Lines:
        """Cut requests, which no line feed has to end."""
        return Objects()

    def answer(self, line: bytes | None) -> bytes:
        """Return the answer to a request: its result, or the error of JSON-RPC."""
        number, said = None, dict[str, Any]()
        try:
            request = json.loads(line or b"", parse_constant=_no_number)
            require(isinstance(request, dict), _NO_REQUEST)
            given = request.get("id")
            require(given is None or type(given) in (int, float, str), _NO_REQUEST)
            number = given
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
        values = request.get("params")
        require(values is None or values == {} or isinstance(values, list), _BAD)
        values = values or []
        try:
            found = self._carried_out(name, values)
        except Refused as refused:
            if isinstance(refused.reason, tuple):  # an error of JSON-RPC
                raise
            return [refused.reason]
        if isinstance(found, str) and name.startswith("system.") and "api" not in request:
            return [found]  # older drivers expect the text alone
        return [0, *(found if isinstance(found, list) else [] if found is None else [found])]

    def _carried_out(self, name: str, values: list[Any]) -> Any:
        if name not in OF_CHANNEL:
            return self.carry_out(OF_CONTROLLER.get(name), self.controller, values)
        axis, *values = values or [None]
        require(type(axis) is int, _BAD)
        return self.carry_out(OF_CHANNEL[name], self.channel(axis), values)

    def read(self, value: Any) -> Any:
        """Return an argument that is a number or a truth value. Raises Refused."""
        require(isinstance(value, int | float) and abs(value) < 2**63, _BAD)
        return value


def _no_number(_: str) -> None:
    """Refuse NaN and Infinity, which are no JSON."""
    raise ValueError


def _flag(value: float) -> bool:
    """Return an argument that has to be a truth value, or 0 or 1. Raises Refused."""
    require(value in (0, 1), _BAD)
    return bool(value)


def _whole(value: float) -> int:
    """Return an argument that has to be a whole number. Raises Refused."""
    require(type(value) is not bool and value == int(value), _BAD)
    return int(value)


def _real(value: float) -> float:
    """Return an argument that has to be a number. Raises Refused."""
    require(type(value) is not bool, _BAD)
    return value


def _taking(run: Callable[..., Any], *kinds: Callable[[Any], Any], moves: bool = False) -> Request:
    """Return a command whose arguments are of some kinds."""

    def checked(whose: Any, *values: Any) -> Any:
        return run(whose, *(kind(one) for kind, one in zip(kinds, values, strict=True)))

    return Request(checked, len(kinds), moves=moves)


class Amc(Controller):
    """The controller: up to three axes."""

    channel = Actor
    dialogue = AmcDialogue

    def of_all(self, read: Callable[[Actor], Any]) -> list[Any]:
        """Return what is read of each of three axes, 0 for those that there are not."""
        found = [read(actor) for actor in self.channels]
        return found + [0] * (_AXES - len(found))

    def position_all(self, *values: float) -> list[Any]:
        """Set the targets of some axes, all or none, and return references and positions of all."""
        pairs = zip(values[:_AXES], values[_AXES:], strict=True)
        wanted = [(number, target) for number, (on, target) in enumerate(pairs) if on]
        for number, target in wanted:
            require(number < len(self.channels), _RANGE)
            self.channels[number].check_target(1e-9 * target)
        for number, target in wanted:
            self.channels[number].set_goal(target)
        known = self.of_all(lambda actor: actor.referenced)
        return [*map(bool, known), *self.of_all(Actor.mark), *self.of_all(lambda actor: actor.nm)]


OF_CHANNEL: dict[str, Request] = {
    "control.setControlOutput": _taking(Actor.enable, _flag),
    "control.getControlOutput": Request(lambda a: a.output),
    "control.setControlAmplitude": _taking(Actor.set_volts, _real),
    "control.getControlAmplitude": Request(lambda a: round(1e3 * a.axis.status.amplitude)),
    "control.setControlFrequency": _taking(Actor.set_hertz, _real),
    "control.getControlFrequency": Request(lambda a: round(1e3 * a.axis.status.frequency)),
    "control.setControlMove": _taking(lambda a, on: a.want(on, 0), _flag),
    "control.getControlMove": Request(lambda a: a.loop),
    "control.setControlTargetRange": _taking(Actor.set_target_range, _whole),
    "control.getControlTargetRange": Request(lambda a: a.target_range),
    "control.setControlFixOutputVoltage": _taking(Actor.set_level, _real, moves=True),
    "control.getControlFixOutputVoltage": Request(lambda a: a.level),
    "control.getCurrentOutputVoltage": Request(lambda a: a.level),
    "control.setReset": Request(lambda a: a.set_position(0.0)),
    "control.searchReferencePosition": Request(Actor.search, moves=True),
    "control.getReferencePosition": Request(Actor.mark),
    "control.getActorName": Request(lambda a: f"SIM-{a.axis.parameters.node.axis_name}"),
    "control.getActorType": Request(lambda a: 0),
    "move.setSingleStep": _taking(lambda a, back: a.step_by(back, 1), _flag, moves=True),
    "move.setNSteps": _taking(Actor.step_by, _flag, _whole, moves=True),
    "move.writeNSteps": _taking(Actor.set_steps, _whole),
    "move.performNSteps": _taking(lambda a, back: a.step_by(back, a.steps), _flag, moves=True),
    "move.getNSteps": Request(lambda a: a.steps),
    "move.setControlContinuousFwd": _taking(lambda a, on: a.want(False, on), _flag),
    "move.getControlContinuousFwd": Request(lambda a: a.jog > 0),
    "move.setControlContinuousBkwd": _taking(lambda a, on: a.want(False, -on), _flag),
    "move.getControlContinuousBkwd": Request(lambda a: a.jog < 0),
    "move.setControlTargetPosition": _taking(Actor.set_goal, _real, moves=True),
    "move.getControlTargetPosition": Request(lambda a: round(1e9 * a.goal, 3)),
    "move.moveReference": Request(Actor.go_to_reference, moves=True),
    "move.getPosition": Request(lambda a: a.nm),
    "status.getStatusConnected": Request(lambda a: True),
    "status.getStatusReference": Request(lambda a: a.referenced),
    "status.getStatusMoving": Request(lambda a: a.motion),
    "status.getStatusEotFwd": Request(lambda a: a.end("high")),
    "status.getStatusEotBkwd": Request(lambda a: a.end("low")),
    "status.getStatusEot": Request(lambda a: a.end("high", "low")),
    "status.getStatusTargetRange": Request(lambda a: a.in_range),
    "status.getOlStatus": Request(lambda a: 0),
    "status.getFullCombinedStatus": Request(lambda a: a.text),
}
for _name in _SETTINGS:
    _room, _, _rest = _name.partition(".")
    OF_CHANNEL[f"{_room}.set{_rest}"], OF_CHANNEL[f"{_room}.get{_rest}"] = stored(_name, _flag)

OF_CONTROLLER: dict[str, Request] = {
    "control.MultiAxisPositioning": _taking(Amc.position_all, *[_flag] * _AXES, *[_real] * _AXES),
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

#: The methods of the interface manual 1.4.0 that nothing is simulated for, by what they belong to;
#: one behind a plus is there twice, with get and with set before it
_NOT_EMULATED = {
    "amcids.": "+LowerSoftLimit +SoftLimitEnabled +UpperSoftLimit getSoftLimitReached resetIdsAxis",
    "control.": (
        "+ActorSensitivity +AutoMeasure +CrosstalkThreshold +EoTParameters +ExternalSensor "
        "+FinePositioningRange +FinePositioningSlewRate +MotionControlThreshold +SensorDirection "
        "MultiAxisPositioningWithTime getActorParametersActorName setActorParametersByName "
        "setActorParametersJson"
    ),
    "description.": "checkChassisNbr getPositionersList",
    "diagnostic.": (
        "getDiagnosticPower getDiagnosticResults getDiagnosticStepSize getDiagnosticTemperature "
        "startDiagnostic"
    ),
    "move.": (
        "+GroundAxis +GroundAxisAutoOnTarget +GroundTargetRange getPositionWithTime "
        "getPositionWithTime_32Bit"
    ),
    "res.": "+ChainGain +Linearization +Mode getLutSn getSensorStatus setConfigurationFile",
    "rotcomp.": "+Enabled +LUT getControlTargetRanges updateOffsets",
    "rtin.": (
        "+ControlAQuadBInResolution +ControlMoveGPIO +GpioMode +NslMux +RealTimeInChangePerPulse "
        "+RealTimeInFeedbackLoopMode +RealTimeInMode +RealTimeInStepsPerPulse apply discard"
    ),
    "rtout.": (
        "+ControlAQuadBOutClock +ControlAQuadBOutResolution +Mode +SignalMode +TriggerConfig "
        "apply applyAxis discard discardAxis discardSignalMode getControlAQuadBOut"
    ),
    "system.about.": "getInstalledPackages getPackageLicense",
    "system.": (
        "apply factoryReset getFluxCode getHostname getMacAddress rebootSystem setDeviceName "
        "setTime softReset updateTimeFromInternet"
    ),
    "system.network.": (
        "+DefaultGateway +DnsResolver +EnableDhcpClient +EnableDhcpServer +IpAddress +ProxyServer "
        "+SubnetMask +WifiMode +WifiPassphrase +WifiSSID apply configureWifi discard "
        "getRealIpAddress getWifiPresent verify"
    ),
    "system.update.": (
        "getLicenseUpdateProgress getSwUpdateProgress licenseUpdateBase64 softwareUpdateBase64 "
        "uploadLicenseBase64 uploadSoftwareImageBase64"
    ),
    "": "grantAccess lock unlock",
}
for _room, _names in _NOT_EMULATED.items():
    _names = re.sub(r"\+(\w+)", r"get\1 set\1", _names)
    OF_CONTROLLER |= lacking(_LACKING, _names, _room)
