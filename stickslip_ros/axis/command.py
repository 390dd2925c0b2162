# SPDX-License-Identifier: Apache-2.0
"""The states of an axis, the shape of a command, and the status of an axis.

`commands.py` defines every command, and what it does in each state. `docs/states.md` shows this as
a table, and as a diagram the transitions without a command (a move ends, a target is reached, a
fault).
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import chain
from typing import Any

from stickslip_ros.axis.events import shorten
from stickslip_ros.physics.parameters import ParameterError
from stickslip_ros.physics.parameters.named_files import is_digest

STOPPED, STEPPING, JOGGING, SCANNING = "stopped", "stepping", "jogging", "scanning"
TARGETING, HOLDING, HOMING = "targeting", "holding", "homing"
FAULT, DISABLED = "fault", "disabled"
STATES = (STOPPED, STEPPING, JOGGING, SCANNING, TARGETING, HOLDING, HOMING, FAULT, DISABLED)

#: In place of a next state: the command leaves the state as it is, or is refused.
SAME, REFUSED = "same", "refused"

#: Wait (s) for the running cycle from which on it is said, and what is said then
LONG_WAIT, STOP_ENDS = 1.0, "stop breaks off the running cycle"

#: State -> next state, `SAME` or `REFUSED`. A running cycle is finished first, if nothing is said.
Row = Mapping[str, str]


def row(active: str, fault: str = REFUSED, disabled: str = REFUSED, **others: str) -> Row:
    """Return the effect of a command in each state.

    ``active`` holds in all states but fault, disabled and those named in ``others``.
    """
    return {**dict.fromkeys(STATES, active), FAULT: fault, DISABLED: disabled, **others}


def refusal(row: Row, state: str, fault: str) -> str:
    """Return why a command is refused in a state, empty if it is not; fault: its reason."""
    if row[state] != REFUSED:
        return ""
    if state == FAULT:
        return f"the axis is in fault ({fault}): reset it first"
    if state == DISABLED:
        return "the axis is disabled: enable it first"
    return f"the axis is {state}: stop it first"


@dataclass(frozen=True)
class AxisStatus:
    """A snapshot. Positions are as measured, counted from the zero that was set, if not said."""

    state: str  #: one of `STATES`
    moving: bool  #: cycles or a ramp are running
    enabled: bool
    paused: bool  #: the time of the axis stands still
    fault: str  #: reason of the fault; empty if there is none
    # -- steps
    steps_done: int  #: of the present or last run of cycles, with sign
    steps_left: int  #: of the present run, with sign; 0 for a jog
    step_count: int  #: all cycles since the start, those to -x taken off: commanded, not measured
    amplitude: float  #: commanded, V
    stroke: float  #: of the actuator at that amplitude, m
    frequency: float  #: commanded, Hz; of a jog its own
    last_step: float  #: displacement over the last cycle, m; nan before the first
    mean_step: float  #: mean over the present or last run, m; nan before its first step
    backstep: float  #: of the last slip, m; nan before the first
    lost: float  #: energy lost in the contact over the last cycle, J; nan before the first
    begins: float  #: when (s) what waits for the running cycle begins; nan if nothing does
    # -- position
    position: float  #: reading of the sensor, m
    zero_offset: float  #: subtracted from the reading, m
    velocity: float  #: mean over the last 10 ms, m/s
    scan_level: float  #: level of the actuator without the drive cycles, V
    load: float  #: external force along the axis, N
    # -- closed loop
    target: float  #: where the closed loop wants to be now, m; nan in open loop
    target_reached: bool
    following_error: float  #: target less position, m; nan in open loop
    # -- limits and refusals
    limits_hit: int  #: ends of the travel and soft limits hit since the start
    held_at: str  #: "low" or "high" while the runner is held by that end of the travel
    injected: str  #: faults on demand that act, with commas; empty if there are none
    refused: int  #: commands refused since the start
    last_error: str  #: reason of the last refusal or fault


#: Types of messages and services, named as in ROS, which this room does not know.
INT32, FLOAT64 = "std_msgs/msg/Int32", "std_msgs/msg/Float64"
WRENCH = "geometry_msgs/msg/WrenchStamped"
JOINT_STATE = "sensor_msgs/msg/JointState"
TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
TRIGGER, SET_BOOL = "std_srvs/srv/Trigger", "std_srvs/srv/SetBool"
SET_PARAMETERS = "rcl_interfaces/srv/SetParametersAtomically"

#: A message of a whole number holds less, and down to minus that.
INT32_RANGE = 2**31


@dataclass(frozen=True)
class Command:
    """One command of an axis. It has either a ``task`` or an ``effect``."""

    name: str  #: of the command and of its events
    type: str  #: of its message or service
    meaning: str
    states: Row
    interface: str = ""  #: topic or service, below the name of the node; empty: by its name
    #: Arguments that an axis at rest with default parameters accepts; the documentation shows them.
    example: tuple[Any, ...] = ()
    #: Names of the arguments in the event; None: one mapping, whose keys are the names.
    arguments: tuple[str, ...] | None = ("value",)
    defaults: tuple[Any, ...] = ()  #: of the last arguments, which may be left out
    field: str = "data"  #: field of the message with a single argument, such as "wrench.force.x"
    #: The axis and the arguments; raises ParameterError for bad ones and changes nothing. What it
    #: returns, unless None, is carried out.
    check: Callable[..., Any] = lambda axis, *arguments: None
    #: The axis and the arguments -> whether they ask for nothing new; then the command is ignored.
    ignored: Callable[..., bool] = lambda axis, *arguments: False
    #: The axis and what is carried out -> the task that replaces what runs, unless it is the same;
    #: None ends what runs.
    task: Callable[..., Any] | None = None
    #: The axis and what is carried out; what runs goes on.
    effect: Callable[..., None] | None = None
    #: Arguments -> whether it breaks off a cycle that would end later than `actuation.SOON`.
    breaks_off: Callable[..., bool] = lambda *arguments: False
    #: Name in the table of states and the row there of 0 or False, if that means something else;
    #: to a command with a task, it ends what runs.
    off: tuple[str, Row] | None = None
    #: What its event holds beside the arguments; gets what is carried out. Raises ParameterError.
    more_details: Callable[..., Mapping[str, Any]] = lambda *prepared: {}
    unit: str = ""
    #: The axis -> lowest and highest value of a number at present.
    limits: Callable[[Any], tuple[float, float]] | None = None
    depth: int = 10  #: messages that may wait

    def __post_init__(self) -> None:
        place = "command/" if self.type in (INT32, FLOAT64) else ""
        object.__setattr__(self, "interface", self.interface or place + self.name)

    @property
    def is_service(self) -> bool:
        """Whether it is a service and not a topic."""
        return "/srv/" in self.type

    @property
    def moves(self) -> bool:
        """Whether it can change the state of the axis, and so ends the running command."""
        return any({*row.values()} - {SAME, REFUSED} for row in self.rows().values())

    def rows(self) -> dict[str, Row]:
        """Return its rows in the table of states by their names."""
        return {self.name: self.states, **dict([self.off] if self.off else [])}

    def turns_off(self, arguments: tuple[Any, ...]) -> bool:
        """Return whether it is 0 or False and that means something else."""
        return self.off is not None and not arguments[0]

    def row(self, arguments: tuple[Any, ...]) -> Row:
        """Return its effect in each state."""
        return self.off[1] if self.off and self.turns_off(arguments) else self.states

    def completed(self, arguments: tuple[Any, ...]) -> tuple[Any, ...]:
        """Return the arguments as plain numbers and lists, with defaults of those left out.

        ParameterError if there are too few or too many, or if one is of another type.
        """
        wanted = ("a mapping",) if self.arguments is None else self.arguments
        missing = len(wanted) - len(arguments)
        what = ", ".join(wanted) or "no value"
        if 0 <= missing <= len(self.defaults):
            left_out = self.defaults[len(self.defaults) - missing :] if missing else ()
            plain = tuple(map(_plain, arguments)) + left_out
            what, suits = _SUITS[self.type]
            if suits(*plain):
                return plain
        given = ", ".join(repr(shorten(one)) for one in arguments) or "nothing"
        raise ParameterError(f"{self.name} takes {what}, not {given}")

    def details(self, arguments: tuple[Any, ...]) -> dict[str, Any]:
        """Return its arguments as the details of an event."""
        if self.arguments is None:
            return dict(arguments[0])
        return dict(zip(self.arguments, arguments, strict=True))

    def arguments_of(self, details: Mapping[str, Any]) -> tuple[Any, ...]:
        """Return the arguments from the details of an event; ValueError for wrong details."""
        if self.arguments is None:
            return ({name: value for name, value in details.items() if not is_digest(name)},)
        left_out = self.arguments[len(self.arguments) - len(self.defaults) :]
        details = {**dict(zip(left_out, self.defaults, strict=True)), **details}
        if lacking := [name for name in self.arguments if name not in details]:
            raise ValueError(f"it lacks {lacking[0]!r}")
        found = tuple(details[name] for name in self.arguments)
        what, suits = _SUITS[self.type]
        if not suits(*found):
            raise ValueError(f"it does not hold {what}")
        return found


def _plain(value: Any) -> Any:
    """Return numbers and arrays of NumPy as those of Python, and sequences as lists."""
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value.tolist() if hasattr(value, "tolist") else value


def _is_number(value: Any) -> bool:
    # A whole number in a bag may be larger than any float.
    return type(value) is float or (type(value) is int and abs(value) <= sys.float_info.max)


def _are_points(joints: Any, points: Any, begin: Any) -> bool:
    return (
        isinstance(joints, list)
        and all(isinstance(joint, str) for joint in joints)
        and isinstance(points, list)
        and all(isinstance(point, list) and len(point) == 2 for point in points)
        and all(map(_is_number, chain(*points)))
        and _is_number(begin)
    )


#: Type of a command's message -> what its arguments are, and whether some can be that
_SUITS: dict[str, tuple[str, Callable[..., bool]]] = {
    INT32: (
        f"a whole number from {-INT32_RANGE} to {INT32_RANGE - 1}",
        lambda value: type(value) is int and -INT32_RANGE <= value < INT32_RANGE,
    ),
    FLOAT64: ("a number", _is_number),
    WRENCH: ("a number", _is_number),
    SET_BOOL: ("True or False", lambda value: isinstance(value, bool)),
    TRAJECTORY: ("a list of joints and one of points, each a time and a position", _are_points),
    JOINT_STATE: (
        'a joint, "position" or "velocity", and a number',
        lambda joint, interface, value: (
            isinstance(joint, str) and interface in ("position", "velocity") and _is_number(value)
        ),
    ),
    TRIGGER: ("no value", lambda: True),
    SET_PARAMETERS: ("a mapping", lambda changes: isinstance(changes, Mapping)),
}
