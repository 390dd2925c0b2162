# SPDX-License-Identifier: Apache-2.0
"""What a waveform says: one cycle of the voltage, in shares of the amplitude."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray


class Shape(NamedTuple):
    """One cycle of the voltage; of many operating points numbers may be arrays (points,).

    A segment that takes no time is left out of the drive cycle. One that takes less than none, or
    that changes the level in no time, makes the shape impossible.
    """

    durations: tuple[Any, ...]  #: of the segments, s
    changes: tuple[Any, ...]  #: of the level within them, shares of the amplitude
    slip: tuple[int, int]  #: first segment of the slip and the one after its last
    start: float = 0.0  #: level at the start, share of the amplitude
    time_for_slip: Any = math.inf  #: what the rest of the cycle leaves to the slip, s

    def rows(self, points: int) -> Rows:
        """Return the shape as rows, segments of no time left out."""
        durations, changes = _columns(self.durations, points), _columns(self.changes, points)
        possible = ~((durations < 0.0) | ((durations == 0.0) & (changes != 0.0))).any(axis=1)
        first, stop = self.slip
        lasts = durations > 0.0
        falls = lasts & (changes < 0.0)
        falls[:, :first] = falls[:, stop:] = False
        index = np.cumsum(lasts, axis=1) - 1  # where each segment comes to stand
        slip = np.take_along_axis(index, np.argmax(falls, axis=1)[:, None], axis=1)[:, 0]
        end = np.where(falls, index, -1).max(axis=1)
        if not lasts.all():
            order = np.argsort(~lasts, axis=1, kind="stable")
            durations = np.take_along_axis(np.where(lasts, durations, 0.0), order, axis=1)
            changes = np.take_along_axis(np.where(lasts, changes, 0.0), order, axis=1)
        return Rows(durations, changes, slip, end - slip + 1, possible)


class Rows(NamedTuple):
    """Shapes of many points without the segments that take no time, one row a point."""

    durations: NDArray[np.float64]  #: (points, segments), s; rows are filled with 0 at the end
    changes: NDArray[np.float64]  #: (points, segments), shares of the amplitude
    slip: NDArray[np.int64]  #: (points,), segment in which the level begins to fall
    slip_parts: NDArray[np.int64]  #: (points,), segments up to the one in which it last falls
    possible: NDArray[np.bool_]  #: (points,)


def _columns(values: tuple[Any, ...], points: int) -> NDArray[np.float64]:
    """Return values, numbers or arrays (points,), as (points, values)."""
    if any(isinstance(value, np.ndarray) for value in values):
        return np.stack([np.broadcast_to(np.asarray(one, float), points) for one in values], axis=1)
    return np.tile(np.array(values, float), (points, 1))
