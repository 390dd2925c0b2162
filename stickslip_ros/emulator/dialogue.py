# SPDX-License-Identifier: Apache-2.0
"""Common parts of all controllers: channels, tables of commands, dialogues line by line.

Everything here is called in one thread, with all axes advanced to the present.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

from stickslip_ros.axis import Axis

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


class Request(NamedTuple):
    """A command of a channel or of the controller."""

    run: Callable[..., Any]  #: gets whose command it is and the arguments, returns the answer
    fewest: int = 0  #: arguments that have to follow
    optional: int = 0  #: arguments that may follow these
    moves: bool = False  #: refused while the channel may not move

    def check_count(self, count: int, too_few: Any, too_many: Any) -> None:
        """Raise Refused with one of these reasons for another count of arguments."""
        if not self.fewest <= count <= self.fewest + self.optional:
            raise Refused(too_few if count < self.fewest else too_many)


class Dialogue:
    """One client of a controller; most protocols begin with its first line and never hang up."""

    greeting = b""  #: sent at the connection
    patience: float | None = None  #: s that the client may stay silent; None: for ever

    def __init__(self, controller: Any) -> None:
        """Begin the dialogue of a client with a `Controller`."""
        self.controller = controller

    def cutter(self) -> Lines:
        """Return what cuts the client's stream."""
        return Lines(LONGEST_LINE)

    def answer(self, line: bytes | None) -> bytes | Waiting:
        """Return the answer to a line without its end; None: one that was too long to keep."""
        raise NotImplementedError

    def over(self) -> bool:
        """Return whether the controller hangs up."""
        return False


class Controller:
    """A controller of several axes."""

    channel: ClassVar[type[Any]]  #: what it keeps beside an axis that it is made of; has a `tick`
    dialogue: ClassVar[type[Dialogue]]

    def __init__(self, axes: Sequence[Axis]) -> None:
        """Make a channel for each axis."""
        self.channels = [type(self).channel(axis) for axis in axes]

    def connect(self) -> Dialogue:
        """Return the dialogue with a new client."""
        return self.dialogue(self)

    def tick(self) -> None:
        """Do the work that is due without a command; called many times a second."""
        for channel in self.channels:
            channel.tick()


class Lines:
    """Cuts a stream into lines that end with CR, LF or both, and never keeps much of it."""

    def __init__(self, longest: int) -> None:
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
