# SPDX-License-Identifier: Apache-2.0
"""The result of a waveform: one cycle of the voltage, in shares of the amplitude."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

Waveform = TypeVar("Waveform", bound=Callable[..., Any])


def with_rows(rows: type) -> Callable[[Waveform], Waveform]:
    """Return a decorator that gives a waveform a dataclass of its own constants."""

    def carry(waveform: Waveform) -> Waveform:
        waveform.rows = rows  # type: ignore[attr-defined]
        return waveform

    return carry


class Shape(NamedTuple):
    """One cycle of the voltage; of many operating points numbers may be arrays (points,).

    A segment that takes no time is left out of the drive cycle. One that takes less than none, or
    that changes the level in no time, makes the shape impossible.
    """

    durations: tuple[Any, ...]  #: of the segments, s
    changes: tuple[Any, ...]  #: of the level within them, shares of the amplitude
    slip: tuple[int, int]  #: first segment of the slip and the one after its last
    start: float = 0.0  #: level at the start, share of the amplitude
    time_for_slip: Any = math.inf  #: time that the rest of the cycle leaves for the slip, s
