# SPDX-License-Identifier: Apache-2.0
"""The base of all errors of this package, and how its programs end."""

from __future__ import annotations

import atexit
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager

#: Characters of an error that is longer than those of ours, which hold a table at most: it repeats
#: a value of a file, which may have a megabyte, and its middle is left out
LONGEST_MESSAGE, _LONGEST_OF_OURS = 300, 1000


def printable(text: str, keep: str = "") -> str:
    """Return a text without characters that a terminal, a page or a file name could obey.

    Text out of foreign files may hold control characters, or turn the direction of writing; they
    are written as in Python, such as ``\\x1b``. Those in ``keep`` stay.
    """
    if text.isprintable():
        return text
    return "".join(
        one if one.isprintable() or one in keep else one.encode("unicode_escape").decode()
        for one in text
    )


class StickslipError(Exception):
    """An error that the caller can correct; the text is one line with the cure."""

    #: What of a text is no line but may stay: a file's text may hold a line that looks like ours
    _keeps = ""

    def __str__(self) -> str:
        """Return the text, as it may be shown anywhere."""
        text = super().__str__()
        text = text if len(text) <= _LONGEST_OF_OURS else f"{text[:180]} ... {text[-115:]}"
        return printable(text, self._keeps)


class UsageError(StickslipError):
    """A command line or a parameter of a node is wrong; the message says what to change."""


class MissingLibrary(StickslipError, ModuleNotFoundError):
    """A library that this needs is not installed; the message says how to install it."""


#: Ends of the names of modules that come with a ROS
_OF_ROS = ("rclpy", "_interfaces", "_msgs", "_srvs")


@contextmanager
def libraries_for(what: str) -> Iterator[None]:
    """Raise MissingLibrary, which names the cure, where an import fails that `what` needs."""
    try:
        yield
    except ModuleNotFoundError as error:
        module = (error.name or "").partition(".")[0]
        if module in ("", "stickslip_ros") or isinstance(error, MissingLibrary):
            raise
        cure = f"pip install {'mcap-ros2-support' if module == 'mcap_ros2' else module}"
        if module.endswith(_OF_ROS):
            cure = "source a ROS, or pip install 'stickslip_ros[ros]'"
        raise MissingLibrary(f"{what} needs {module}: {cure}", name=module) from error


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
