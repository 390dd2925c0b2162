# SPDX-License-Identifier: Apache-2.0
"""Real-time priority of a thread."""

from __future__ import annotations

import os


def request_priority(priority: int | None) -> str:
    """Request a priority of SCHED_FIFO for the calling thread; return the result.

    None and 0 request nothing. The answer starts with "off", "granted" or "refused".
    """
    if not priority:
        return "off"
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except (OSError, AttributeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "this system knows no SCHED_FIFO"
        return f"refused: {reason} (on Linux allow it with `ulimit -r {priority}` or CAP_SYS_NICE)"
    return f"granted: SCHED_FIFO {priority}"
