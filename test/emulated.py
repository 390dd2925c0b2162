# SPDX-License-Identifier: Apache-2.0
"""An emulator in the test's process, and a client that says what it wants to read."""

from __future__ import annotations

import socket
from collections.abc import Callable
from pathlib import Path
from typing import Any

from stickslip_ros.axis import Axis
from stickslip_ros.emulator import OwnAxes, Recorder, ServerThread, controller_of

TIMEOUT = 20.0  # s


class Emulated:
    """A controller with its axes, served on a free port, and recorded if a folder is named."""

    def __init__(self, name: str, axes: list[Axis], record: Path | None = None) -> None:
        own, controller = OwnAxes(axes), controller_of(name, axes)
        own.begin()
        self.axes = axes
        self._recorder = controller.recorder = Recorder(record, name, axes) if record else None
        own.forgets = record is None
        self.server = ServerThread(controller, own.run)
        self.port = self.server.port

    def close(self) -> None:
        """Hang up and close the recording."""
        self.server.close()
        if self._recorder:
            self._recorder.close()

    def look(self, what: Callable[[], Any]) -> Any:
        """Return something of the axes at the present time."""
        return self.server.call(what)

    def client(self) -> Client:
        return Client(self.port)


class Client:
    """Sends bytes and reads up to others."""

    def __init__(self, port: int) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port), TIMEOUT)
        self._kept = b""

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        self.socket.close()

    def send(self, data: bytes) -> None:
        self.socket.sendall(data)

    def until(self, end: bytes) -> bytes:
        """Return what comes up to that end, with it; all that is left if the other hangs up."""
        while end not in self._kept:
            data = self.socket.recv(4096)
            if not data:
                found, self._kept = self._kept, b""
                return found
            self._kept += data
        found, _, self._kept = self._kept.partition(end)
        return found + end

    def ask(self, line: str, end: bytes = b"\n") -> str:
        """Send a line and return the answer without its end."""
        self.send(line.encode() + b"\r\n")
        return self.until(end).removesuffix(end).decode()
