# SPDX-License-Identifier: Apache-2.0
"""Common parts of all controllers: dialogues line by line, tables of commands, channels.

Everything here is called in one thread, with all axes advanced to the present.
"""

from __future__ import annotations

import logging
import math
import re
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

from stickslip_ros.axis import Axis, CommandRefused
from stickslip_ros.axis.command import DISABLED, FAULT, HOLDING, TARGETING
from stickslip_ros.physics.parameters import ParameterError

if TYPE_CHECKING:
    from stickslip_ros.emulator.recorder import Recorder

_LOG = logging.getLogger(__name__)
LONGEST_LINE = 4096  # bytes; a pattern of 256 numbers takes a thousand


@dataclass(frozen=True)
class Waiting:
    """An answer that comes later."""

    done: Callable[[], bool]  #: whether it may be given; asked again and again
    answer: Callable[[], bytes]  #: the answer, once it may be given


class Refused(Exception):
    """A command that is not carried out."""

    def __init__(self, reason: Any) -> None:
        """Keep the reason: a code or a text, as the protocol answers it."""
        super().__init__(reason)
        self.reason = reason


def require(condition: object, reason: Any) -> None:
    """Raise Refused with a reason unless a condition holds."""
    if not condition:
        raise Refused(reason)


class Request(NamedTuple):
    """A command of a channel or of the controller."""

    run: Callable[..., Any]  #: gets whose command it is and the arguments, returns the answer
    fewest: int = 0  #: arguments that have to follow
    optional: int = 0  #: arguments that may follow these
    moves: bool = False  #: refused while the channel may not move
    #: Name of a command that the device has and the emulator has not; run gives the reason.
    lacking: str = ""


def lacking(reason: Any, names: str, room: str = "") -> dict[str, Request]:
    """Return commands that a device has and nothing is simulated for, by name.

    names has them all, room goes before each. They are refused with the reason, whatever follows
    them, and the log tells each once.
    """
    return {
        f"{room}{name}": Request(lambda *_: reason, lacking=f"{room}{name}")
        for name in names.split()
    }


def within(low: float, high: float, reason: Any) -> Callable[..., Any]:
    """Return what reads a number from low to high. It raises Refused for others."""

    def read(value: Any) -> Any:
        require(low <= value <= high, reason)
        return value

    return read


def stored(
    name: Hashable,
    read: Callable[..., Any],
    count: int = 1,
    show: Callable[[Any], Any] = lambda value: value,
) -> tuple[Request, Request]:
    """Return the commands that set and get one of the settings of a channel.

    read makes the setting of the arguments, of which there are count; show makes the answer of it.
    """

    def keep(channel: Any, *values: Any) -> None:
        channel.settings[name] = read(*values)

    return Request(keep, count), Request(lambda channel: show(channel.settings[name]))


class Reasons(NamedTuple):
    """Why commands are refused, as a protocol answers it."""

    unknown: Any
    no_channel: Any  #: there is none of that number
    too_few: Any  #: arguments
    too_many: Any
    locked: Any  #: the channel may not move
    impossible: Any  #: for the axis, with these values or in this state


class Dialogue:
    """One client of a controller; most protocols begin with its first line and never hang up."""

    greeting = b""  #: sent at the connection
    patience: float | None = None  #: s that the client may stay silent; None: for ever
    reasons: ClassVar[Reasons]

    def __init__(self, controller: Any) -> None:
        """Begin the dialogue of a client with a `Controller`."""
        self.controller = controller
        self.number = 0  #: of the client, from 1 on

    def cutter(self) -> Lines:
        """Return what cuts the client's stream."""
        return Lines()

    def answer(self, line: bytes | None) -> bytes | Waiting:
        """Return the answer to a line without its end; None: one that was too long to keep."""
        raise NotImplementedError

    def news(self) -> bytes:
        """Return what the client is told without asking; called many times a second."""
        return b""

    def over(self) -> bool:
        """Return whether the controller hangs up."""
        return False

    def read(self, value: Any) -> Any:
        """Return an argument as commands take it. Raises Refused."""
        return value

    def channel(self, number: int) -> Any:
        """Return a channel, counted from 0 on. Raises Refused."""
        require(0 <= number < len(self.controller.channels), self.reasons.no_channel)
        return self.controller.channels[number]

    def carry_out(self, command: Request | None, whose: Any, values: Sequence[Any]) -> Any:
        """Return the answer to a command of a channel or the controller. Raises Refused."""
        if command is None:
            raise Refused(self.reasons.unknown)
        if command.lacking:
            self._tell_once(command.lacking)
            raise Refused(command.run())
        require(len(values) >= command.fewest, self.reasons.too_few)
        require(len(values) <= command.fewest + command.optional, self.reasons.too_many)
        values = [self.read(value) for value in values]
        require(not (command.moves and whose.locked), self.reasons.locked)
        try:
            return command.run(whose, *values)
        except CommandRefused as refusal:
            raise Refused(self.reasons.impossible) from refusal

    def _tell_once(self, name: str) -> None:
        """Log that a program has sent a command that the device has and the emulator has not."""
        controller = self.controller
        if name not in controller.told:
            controller.told.add(name)
            kind = type(controller).__name__
            _LOG.warning("%s: %s is not emulated; it is refused (docs/emulator.md)", kind, name)


class Controller:
    """A controller of several axes."""

    channel: ClassVar[type[Any]]  #: what it keeps beside an axis that it is made of; has a `tick`
    dialogue: ClassVar[type[Dialogue]]

    def __init__(self, axes: Sequence[Axis]) -> None:
        """Make a channel for each axis."""
        self.channels = [type(self).channel(axis) for axis in axes]
        self.recorder: Recorder | None = None  #: hears everything, where somebody records
        self._clients = 0
        self.told: set[str] = set()  #: commands that the log says are not emulated

    def connect(self) -> Dialogue:
        """Return the dialogue with a new client."""
        dialogue = self.dialogue(self)
        self._clients = dialogue.number = self._clients + 1
        self._record(dialogue, "(connects)")
        return dialogue

    def disconnect(self, dialogue: Dialogue) -> None:
        """Note that a client has gone; what it began goes on, as on the device."""
        self._record(dialogue, "(disconnects)")

    def hear(self, dialogue: Dialogue, line: bytes | None) -> bytes | Waiting:
        """Return the answer of a dialogue to a line."""
        answer = dialogue.answer(line)
        shown = b"(waits)" if isinstance(answer, Waiting) else answer
        self._record(dialogue, _shown(b"(too long)" if line is None else line), shown)
        return answer

    def _record(self, dialogue: Dialogue, said: str, answer: bytes = b"") -> None:
        if self.recorder:
            self.recorder.hear(dialogue.number, said, _shown(answer))

    def tick(self) -> None:
        """Do the work that is due without a command; called many times a second."""
        if self.recorder:
            self.recorder.take()
        for channel in self.channels:
            channel.tick()


def _shown(data: bytes) -> str:
    """Return data as a text in which everything but plain characters is escaped."""
    return data.decode("latin-1").encode("unicode_escape").decode()


class Lines:
    """Cuts a stream into lines that end with CR, LF or both, and never keeps much of it."""

    def __init__(self, longest: int = LONGEST_LINE) -> None:
        """Limit lines to a number of bytes."""
        self._longest = longest
        self._kept = b""
        self._too_long = False
        self._after_cr = False

    def take(self, data: bytes) -> list[bytes | None]:
        """Return the lines that end in the data, None for each that was too long."""
        if not data:
            return []  # a line feed that follows still belongs to the CR before
        if self._after_cr:
            data = data.removeprefix(b"\n")
        self._after_cr = data.endswith(b"\r")
        *ended, rest = re.split(rb"\r\n|\r|\n", data)
        found: list[bytes | None] = []
        for part in ended:
            found.append(self._whole(part))
            self._kept, self._too_long = b"", False
        rest = self._kept + rest
        self._too_long |= len(rest) > self._longest
        self._kept = b"" if self._too_long else rest
        return found

    def _whole(self, end: bytes) -> bytes | None:
        line = self._kept + end
        return None if self._too_long or len(line) > self._longest else line


class Channel:
    """An axis with a sensor, and the state of the controller for it: origin, steps, closed loop."""

    most_volts: ClassVar = math.inf  #: largest amplitude of the controller, V
    #: Settings that are only stored and reported, as they are at the start
    first_settings: ClassVar[Mapping[Any, Any]] = {}

    def __init__(self, axis: Axis) -> None:
        """Use an axis; limit its amplitude to the largest of the controller."""
        self.axis = axis
        self.settings = dict(self.first_settings)
        self._origin = 0.0  # reading of the axis (m) that counts as 0
        self._target = math.nan  # of the closed loop that was begun here, m
        self._hold_s = math.inf  # that it is kept
        self._held_since: float | None = None
        self.referenced = False  #: where the position counts from is known
        self._seeking = False  # its reference mark is on its way
        self._zeroes = False  # the mark will count as 0
        if axis.status.amplitude > self.most_volts:
            axis.command("amplitude", self.most_volts)

    @property
    def position(self) -> float:
        """Measured position, m. Raises CommandRefused while the sensor gives none."""
        return self._reading - self._origin

    @property
    def _reading(self) -> float:
        reading = self.axis.status.position
        if math.isnan(reading):
            raise CommandRefused("the sensor gives no reading")
        return reading

    def set_position(self, x: float) -> None:
        """Let the present position count as x (m)."""
        self._origin = self._reading - x

    @property
    def target(self) -> float:
        """Target of the closed loop, m; the position if there is none."""
        target = self.axis.status.target
        return self.position if math.isnan(target) else target - self._origin

    @property
    def reach(self) -> tuple[float, float]:
        """Lowest and highest position that the limits allow, m."""
        low, high = self.axis.config.reach
        return low - self._origin, high - self._origin

    def check_target(self, x: float) -> None:
        """Raise CommandRefused for a position (m) that the limits do not allow."""
        try:
            self.axis.config.check_target(x + self._origin)
        except ParameterError as error:
            raise CommandRefused(str(error)) from None

    def limit(self, name: str) -> float:
        """Return a soft limit, "soft_low" or "soft_high", as positions count, m."""
        return float(getattr(self.axis.parameters.limits, name) - self._origin)

    def set_limits(self, **limits: float) -> None:
        """Set soft limits by name, as positions count, m."""
        self.axis.command("parameters", {name: x + self._origin for name, x in limits.items()})

    @property
    def moving(self) -> bool:
        """Whether it moves, or its closed loop has not reached the target yet."""
        return self.axis.moving or self.axis.mode == TARGETING

    @property
    def locked(self) -> bool:
        """Whether no motion is allowed: the axis is in fault, or disabled."""
        return self.axis.mode in (FAULT, DISABLED)

    def step(self, steps: int, volts: float, hertz: float, endless: bool) -> None:
        """Run steps with an amplitude (V) and frequency (Hz); endless: only the sign counts."""
        axis = self.axis
        if not volts or not steps:
            axis.command("stop")
            return
        self.set_drive(volts, hertz)
        if endless:
            axis.command("jog", math.copysign(hertz, steps))
        else:
            axis.command("steps", steps)

    def set_drive(self, volts: float, hertz: float) -> None:
        """Set amplitude (V) and frequency (Hz), first the one that eases the drive.

        Both or, with CommandRefused, none.
        """
        try:
            self.axis.config.check_drive(self.axis.config.nearest(volts), hertz)
        except ParameterError as error:
            raise CommandRefused(str(error)) from None
        if hertz < self.axis.status.frequency:
            self.axis.command("frequency", hertz)
            self.axis.command("amplitude", volts)
        else:
            self.axis.command("amplitude", volts)
            self.axis.command("frequency", hertz)

    def go_to(self, x: float, hold_s: float) -> None:
        """Go to a position (m) in closed loop, hold it for a time (s)."""
        self._go(x + self._origin, hold_s)

    def _go(self, target: float, hold_s: float) -> None:
        """Go to a position as the axis itself counts it (m), hold it for a time (s)."""
        self.axis.command("position", target)
        self._target, self._hold_s, self._held_since = target, hold_s, None
        self._seeking = False

    def find_reference(self, hold_s: float, zero: bool) -> None:
        """Go to the reference mark, where the axis itself counts 0, and hold it for a time (s).

        zero: the mark counts as 0 from then on.
        """
        self._go(0.0, hold_s)
        self.referenced, self._seeking, self._zeroes = False, True, zero

    @property
    def referencing(self) -> bool:
        """Whether it is on its way to the reference mark."""
        return self._seeking and self.axis.mode == TARGETING

    def tick(self) -> None:
        """End the way to the mark, and the hold of a target after its time.

        Both unless another client, or a topic, has taken the axis elsewhere meanwhile.
        """
        axis = self.axis
        if axis.mode == TARGETING and axis.status.target == self._target:
            return
        if axis.mode != HOLDING or axis.status.target != self._target:
            self._held_since, self._seeking = None, False
            return
        if self._seeking:
            self.referenced, self._seeking = True, False
            self._origin = 0.0 if self._zeroes else self._origin
        if self._held_since is None:
            self._held_since = axis.state.t
        if axis.state.t - self._held_since >= self._hold_s:
            axis.command("stop")
