# SPDX-License-Identifier: Apache-2.0
"""The base of all errors of this package, and how its programs end."""

from __future__ import annotations

import atexit
import os
import signal
import sys


class StickslipError(Exception):
    """An error that the caller can correct; the text is one line with the cure."""


#: Exit code after Ctrl-C, as of any program that a signal has ended: 128 and the signal
INTERRUPTED = 130
#: What is said where memory is short
OUT_OF_MEMORY = (
    "out of memory; ask for less at once, close other programs or raise the limit (ulimit -v)"
)


def ending_signals() -> list[signal.Signals]:
    """Return the signals that ask a program to end; SIGHUP, too, unless nohup ignores it."""
    names = [signal.SIGINT, signal.SIGTERM]
    if sys.platform != "win32" and signal.getsignal(signal.SIGHUP) != signal.SIG_IGN:
        names.append(signal.SIGHUP)
    return names


def end_process(code: int) -> int:
    """End this process after everything is closed, without unloading compiled code (0.3 s).

    Where its output cannot be written the code is returned, and Python ends as usual.
    """
    try:
        atexit._run_exitfuncs()
        sys.stdout.flush()
        sys.stderr.flush()
    except (OSError, ValueError):
        return code
    os._exit(code)
