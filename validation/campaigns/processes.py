# SPDX-License-Identifier: Apache-2.0
"""Processes watched from outside: their ends, their memory, and what they waited for.

On a busy machine a process waits for its turn. That time tells of the machine, not of the process,
so campaigns take it off.
"""

from __future__ import annotations

import os
import time
from pathlib import Path

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
