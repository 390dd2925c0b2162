# SPDX-License-Identifier: Apache-2.0
"""How the fuzz tests search: for so long, with the same examples in every run, one by one.

``STICKSLIP_FUZZ_S`` sets the seconds of each test, ``STICKSLIP_FUZZ_SEED`` the first of the seeds.
"""

import os
import time
from collections.abc import Callable, Iterable
from itertools import count
from pathlib import Path
from typing import TypeVar

import pytest
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis.strategies import SearchStrategy

SECONDS = float(os.environ.get("STICKSLIP_FUZZ_S", "8"))
SEED = int(os.environ.get("STICKSLIP_FUZZ_SEED", "0"))
_ROUND = 20  # examples of one seed
MOST_GROWTH = 50.0  # MB
#: The limit of a test, which holds for searches of hours too.
TIME = pytest.mark.timeout(600 + 3 * SECONDS)

T = TypeVar("T")


def search(strategy: SearchStrategy[T], check: Callable[[T], None], finds: Iterable[T] = ()) -> int:
    """Check examples until the time is up, those found earlier first; return how many.

    What fails is made as small as it can be before it is told.
    """
    done = 0
    for one in finds:
        check(one)
    end = time.monotonic() + SECONDS
    for number in count(SEED):

        @seed(number)
        @settings(
            max_examples=_ROUND,
            deadline=None,
            database=None,
            derandomize=False,
            phases=(Phase.generate, Phase.shrink),
            suppress_health_check=list(HealthCheck),
            print_blob=False,
        )
        @given(strategy)
        def check_round(example: T) -> None:
            nonlocal done
            done += 1
            if time.monotonic() < end:
                check(example)

        check_round()
        if time.monotonic() > end:
            return done
    raise AssertionError("unreachable")


def megabytes(pid: int) -> float:
    """Return the memory of a process."""
    status = Path(f"/proc/{pid}/status").read_text()
    return int(status.partition("VmRSS:")[2].split()[0]) / 1000
