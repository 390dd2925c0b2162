# SPDX-License-Identifier: Apache-2.0
"""How long processes have computed: what tests limit instead of time that passes.

On a busy machine a process waits for its turn, so a limit on the time that passes tells of the
machine, not of the process.
"""

import os
import resource
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


def cpu_seconds(pid: int) -> float:
    """Return the time that a process that still runs has computed, with all its threads."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@contextmanager
def computes_at_most(seconds: float, pid: int) -> Iterator[None]:
    """Fail if a child computes for longer from here to its end, which the block waits for.

    No other child may be waited for meanwhile.
    """
    before = cpu_seconds(pid)
    ended = _of_ended_children()
    yield
    took = _of_ended_children() - ended - before
    assert took < seconds, f"computed for {took:.2f} s to its end; the limit is {seconds:g} s"


def _of_ended_children() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
