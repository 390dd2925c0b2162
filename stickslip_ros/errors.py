# SPDX-License-Identifier: Apache-2.0
"""The base of every error that this package raises on purpose, and how its programs end."""

from __future__ import annotations

import atexit
import os
import signal
import sys


class StickslipError(Exception):
    """Something that the caller can put right; the text is one line with the cure."""


#: Exit code after Ctrl-C, as of any program that a signal has ended: 128 and the signal
INTERRUPTED = 130
#: What is said where memory is short
OUT_OF_MEMORY = (
    "out of memory; ask for less at once, close other programs or raise the limit (ulimit -v)"
)


def ending_signals() -> list[signal.Signals]:
    """Return what asks a program to end: SIGHUP, too, when its terminal closes, but for nohup."""
    names = [signal.SIGINT, signal.SIGTERM]
    if sys.platform != "win32" and signal.getsignal(signal.SIGHUP) != signal.SIG_IGN:
        names.append(signal.SIGHUP)
    return names


def end_process(code: int) -> int:
    """End this process, once everything is closed; to unload compiled code would take 0.3 s.

    Where its output cannot be written the code is returned, and Python ends as usual.
    """
    try:
        atexit._run_exitfuncs()
        sys.stdout.flush()
        sys.stderr.flush()
    except (OSError, ValueError):
        return code
    os._exit(code)
