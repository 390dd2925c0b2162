# SPDX-License-Identifier: Apache-2.0
"""Entry point of the command ``stickslip``."""

from __future__ import annotations

import contextlib
import errno
import os
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from types import FrameType

from stickslip_ros.base.errors import INTERRUPTED, end_process, ending_signals

_AGAIN = 0.01  # s


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return 0, 1 for a finding, 2 for bad use, 130 after a signal.

    Without argv, that of the process is taken, and the process ends.
    """
    with _caught_signals() as caught:
        try:
            code = _run(argv)
        except KeyboardInterrupt:
            code = _interrupted()
        except Exception:
            if not caught:
                raise
            code = _interrupted()  # libraries that are interrupted as they load fail in other ways
    return end_process(code) if argv is None else code


def _run(argv: Sequence[str] | None) -> int:
    try:
        # The threads of linear algebra on small matrices only wait for each other, busily.
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        # Its libraries may take a second to load: here, where Ctrl-C is met.
        from stickslip_ros.cli.command_line import run

        try:
            return run(argv)
        finally:
            print(end="", flush=True)  # flush while its failure can still be handled
    except OSError as error:
        gone = isinstance(error, BrokenPipeError)  # the reader of our output, as `head` does
        if not gone and (error.filename is not None or error.errno != errno.ENOSPC):
            raise
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if gone:
            return 0
        print(f"stickslip: the output cannot be written: {error.strerror}", file=sys.stderr)
        return 2


def _interrupted() -> int:
    print("stickslip: interrupted", file=sys.stderr)
    return INTERRUPTED


@contextlib.contextmanager
def _caught_signals() -> Iterator[list[int]]:
    """Raise KeyboardInterrupt at signals that ask to end, and collect them.

    Python ignores an exception in a destructor or in a callback of a library, with a message. The
    signal is then raised again a moment later.
    """
    caught: list[int] = []
    report = sys.unraisablehook

    def interrupt_again(ignored: sys.UnraisableHookArgs) -> None:
        if issubclass(ignored.exc_type, KeyboardInterrupt):
            threading.Timer(_AGAIN, os.kill, (os.getpid(), caught[-1])).start()
        else:
            report(ignored)

    def interrupt(number: int, frame: FrameType | None) -> None:
        caught.append(number)
        raise KeyboardInterrupt

    # A shell makes background processes ignore Ctrl-C, which is meant for others.
    numbers = [number for number in ending_signals() if signal.getsignal(number) != signal.SIG_IGN]
    before = [signal.signal(number, interrupt) for number in numbers]
    sys.unraisablehook = interrupt_again
    try:
        yield caught
    finally:
        sys.unraisablehook = report
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)


if __name__ == "__main__":
    sys.exit(main())
