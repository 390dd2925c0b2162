# SPDX-License-Identifier: Apache-2.0
"""Runs a node of the package in a child process, with its log in a file."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from stickslip_ros.base.errors import StickslipError

_TIMEOUT = 60.0  # s


class ChildError(StickslipError):
    """A process did not do its part; the message holds its last words."""

    _keeps = "\n"


class ChildProcess:
    """A node that runs; `child_node` makes it."""

    def __init__(self, name: str, log: Path, child: subprocess.Popen[bytes]) -> None:
        """Take over a process whose output goes to a log."""
        self._name, self._log, self._child = name, log, child

    @property
    def pid(self) -> int:
        """Its number."""
        return self._child.pid

    def wait_for(self, text: str) -> None:
        """Wait for a text in the log; ChildError if it does not come."""
        deadline = time.monotonic() + _TIMEOUT
        while text not in self._said():
            if self._child.poll() is not None or time.monotonic() > deadline:
                raise ChildError(f"{self._name} did not start: {self._said().strip()}")
            time.sleep(0.02)

    def check_running(self) -> None:
        """Raise ChildError if it has ended."""
        if self._child.poll() is not None:
            raise ChildError(f"{self._name} has ended: {self._said().strip()[-500:]}")

    def interrupt(self) -> None:
        """Ask it to end, as Ctrl-C does."""
        self._child.send_signal(signal.SIGINT)

    def ended(self) -> None:
        """Wait for the end; ChildError if it was a bad one."""
        try:
            code = self._child.wait(_TIMEOUT)
        except subprocess.TimeoutExpired:
            raise ChildError(f"{self._name} did not end: {self._said().strip()}") from None
        if code != 0:
            raise ChildError(f"{self._name} failed: {self._said().strip()}")

    def end(self) -> None:
        """End it by any means; nothing happens if it has ended."""
        if self._child.poll() is None:
            self.interrupt()
            try:
                self._child.wait(10.0)
            except subprocess.TimeoutExpired:
                self._child.kill()
                self._child.wait()

    def _said(self) -> str:
        return self._log.read_text(encoding="utf-8", errors="replace")


@contextlib.contextmanager
def child_node(
    name: str, folder: Path, *ros_args: str, own_session: bool = False
) -> Iterator[ChildProcess]:
    """Run a node with arguments of ROS, its log in a folder; at the end of the block it ends.

    With own_session, Ctrl-C in the terminal reaches only the program that started it.
    """
    log = folder / f"{name}.log"
    command = [sys.executable, "-m", "stickslip_ros.executables", name, "--ros-args", *ros_args]
    with log.open("wb") as stream:
        child = ChildProcess(
            name,
            log,
            subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=stream,
                stderr=subprocess.STDOUT,
                start_new_session=own_session,
            ),
        )
    try:
        yield child
    finally:
        child.end()


def choose_domain() -> None:
    """Keep the nodes to this machine and, unless one is given, to a domain of their own."""
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
