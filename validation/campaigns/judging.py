# SPDX-License-Identifier: Apache-2.0
"""Cases by their numbers, each judged in a child within its time."""

from __future__ import annotations

import contextlib
import multiprocessing
import signal
import traceback
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from types import FrameType
from typing import TypeVar

Case = TypeVar("Case")


class TookTooLong(BaseException):
    """A case needs more than its time; nothing on the way may take it for an error."""


def within(seconds: float, judge: Callable[[], str]) -> str:
    """Return an outcome, within a time (s of the processor); an exception is a fault."""

    def stop(number: int, frame: FrameType | None) -> None:
        raise TookTooLong

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        return judge()
    except TookTooLong:
        return f"more than {seconds:g} s"
    except Exception as error:
        at = traceback.extract_tb(error.__traceback__)
        ours = [one for one in at if "stickslip_ros" in one.filename] or at
        where = f"{Path(ours[-1].filename).name}:{ours[-1].lineno}"
        return f"{type(error).__name__}: {error} ({where})"
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


def judged(
    judge: Callable[[Case], str], cases: Iterable[Case], deaf: float
) -> Iterator[tuple[Case, str]]:
    """Judge in a child, which is ended and replaced where it answers no more (s)."""
    pool = multiprocessing.Pool(1)
    try:
        for case in cases:
            try:
                said = pool.apply_async(judge, (case,)).get(deaf)
            except multiprocessing.TimeoutError:
                for child in multiprocessing.active_children():
                    child.kill()  # a command takes a SIGTERM for an end of its own, and goes on
                pool.terminate()
                pool, said = multiprocessing.Pool(1), f"deaf for {deaf:g} s"
            yield case, said
    finally:
        pool.terminate()


def study(
    judge: Callable[[Case], str],
    drawn: Callable[[int], Case],
    numbers: Sequence[int],
    good: Sequence[str],
    deaf: float,
    tell: Callable[[Case], str],
    family: Callable[[Case], str] = lambda case: "",
) -> int:
    """Print the faults and how many of each outcome there were; return 1 for a fault.

    deaf: s after which a child that does not even hear its own alarm is ended; family: what
    outcomes are counted by as well.
    """
    counts = Counter[str]()
    with contextlib.suppress(KeyboardInterrupt):  # of what was judged until then
        found = judged(judge, map(drawn, numbers), deaf)
        for number, (case, said) in zip(numbers, found, strict=True):
            kind = said if said in good else "fault"
            counts.update({kind, f"{family(case)} {kind}".strip()})
            if kind == "fault":
                print(f"{number}: {said}\n    {tell(case)}", flush=True)
    print(", ".join(f"{kind} {count}" for kind, count in sorted(counts.items())))
    return int(counts["fault"] > 0)
