# SPDX-License-Identifier: Apache-2.0
"""Processes watched from outside: their ends, their memory, and what they waited for.

On a busy machine a process waits for its turn. That time tells of the machine, not of the process,
so campaigns take it off.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from child import environment

from stickslip_ros.base.child_process import ChildProcess

PATIENCE = 60.0  # s
FAKETIME = next(Path("/usr/lib").glob("*/faketime/libfaketimeMT.so.1"), None)


def ended(pid: int, seconds: float) -> bool:
    """Wait for the end of a child, which can still be looked at; return False if it runs on."""
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        if os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT):
            return True
        time.sleep(1e-3)
    return False


def waited(pid: int) -> float:
    """Return how long the main thread of a process has waited for a processor, s."""
    return 1e-9 * int(Path(f"/proc/{pid}/schedstat").read_text().split()[1])


def waited_here() -> float:
    """Return how long the threads of this process have waited for a processor, s."""
    threads = Path("/proc/self/task").glob("*/schedstat")
    return 1e-9 * sum(int(thread.read_text().split()[1]) for thread in threads)


def memory_of(pid: int) -> float:
    """Return the memory that a process holds, MB."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return 1e-6 * pages * os.sysconf("SC_PAGE_SIZE")


def with_clock_of(file: Path) -> dict[str, str]:
    """Return the environment of processes whose clock a file sets (``+1d``), by libfaketime.

    The steady clock goes on, and files keep their times: to fake those makes a start slow.
    """
    return {
        "LD_PRELOAD": str(FAKETIME),
        "FAKETIME_TIMESTAMP_FILE": str(file),
        "FAKETIME_CACHE_DURATION": "1",
        "FAKETIME_DONT_FAKE_MONOTONIC": "1",
        "NO_FAKE_STAT": "1",
    }


class Program(ChildProcess):
    """A program of the package in a folder and a session of its own; its end is measured."""

    def __init__(
        self,
        folder: Path,
        *words: str,
        module: str = "stickslip_ros.executables",
        **changes: str,
    ) -> None:
        """Start it; changes are those of the environment."""
        with (folder / "log").open("wb") as log:
            child = subprocess.Popen(
                [sys.executable, "-m", module, *words], cwd=folder, env=environment(**changes),
                stdin=subprocess.DEVNULL, stdout=log, stderr=log, start_new_session=True,
            )  # fmt: skip
        super().__init__(words[0], folder / "log", child)

    @property
    def said(self) -> str:
        """All that it has said."""
        return self._said()

    def signalled(self, number: int, seconds: float = PATIENCE, group: bool = False) -> float:
        """Send a signal; return how long it took to the end, s, without waiting for a processor."""
        before, begin = waited(self.pid) + waited_here(), time.monotonic()
        # Popen would reap one that has just ended.
        (os.killpg if group else os.kill)(self.pid, number)
        ended(self.pid, seconds)
        return time.monotonic() - begin - (waited(self.pid) + waited_here() - before)

    def closed(self) -> tuple[int, list[str]]:
        """Wait for the end, by force if it does not come; return its exit code, what was bad."""
        found = []
        if not ended(self.pid, PATIENCE):
            found.append(f"it still ran after {PATIENCE:g} s")
            self._child.kill()
        code = self._child.wait()
        try:
            os.killpg(self.pid, signal.SIGKILL)
            found.append("it left a process")
        except ProcessLookupError:
            pass
        return code, found

    def faults(self, *codes: int) -> list[str]:
        """Wait for the end; return what was bad, an exit code other than these and a traceback."""
        code, found = self.closed()
        if code not in codes:
            found.append(f"exit code {code} instead of {' or '.join(map(str, codes))}")
        if "Traceback" in self.said:
            found.append(self.said[self.said.index("Traceback") :][:800])
        return found
