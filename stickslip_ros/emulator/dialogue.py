# SPDX-License-Identifier: Apache-2.0
"""What the server asks of a controller: a dialogue with each client, line by line.

Everything here is called in one thread, with all axes advanced to the present.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True)
class Waiting:
    """An answer that comes later."""

    done: Callable[[], bool]  #: whether it may be given; asked again and again
    answer: Callable[[], bytes]  #: the answer, once it may be given


class Dialogue(Protocol):
    """One client of a controller."""

    greeting: bytes  #: sent at the connection
    patience: float | None  #: s that the client may stay silent; None: for ever

    def answer(self, line: bytes | None) -> bytes | Waiting:
        """Return the answer to a line without its end; None: one that was too long to keep."""

    def over(self) -> bool:
        """Return whether the controller hangs up."""


class Controller(Protocol):
    """A controller of several axes."""

    name: str

    def connect(self) -> Dialogue:
        """Return the dialogue with a new client."""

    def tick(self) -> None:
        """Do what is due without a command; called many times a second."""


class Lines:
    """Cuts a stream into lines that end with CR, LF or both, and never keeps much of it."""

    def __init__(self, longest: int) -> None:
        """Keep lines of so many bytes at most."""
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
