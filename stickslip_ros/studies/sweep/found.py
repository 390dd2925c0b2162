# SPDX-License-Identifier: Apache-2.0
"""What a sweep has found so far: counts and extremes, and the values if they are needed."""

from __future__ import annotations

import json
import math

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.studies.sweep.metrics import METRICS
from stickslip_ros.studies.sweep.sweep import Sweep


class Found:
    """Takes the parts of a sweep as they come; without ``keep`` its memory does not grow."""

    def __init__(self, sweep: Sweep, keep: bool) -> None:
        """Begin with nothing; keep says whether values are kept, for `json` and pictures."""
        self._sweep = sweep
        self.done = 0
        self.empty = 0
        self._first_empty = 0
        self._low = np.full(len(sweep.metrics), math.inf)
        self._high = np.full(len(sweep.metrics), -math.inf)
        shape = (sweep.points, len(sweep.metrics))
        self.kept: NDArray[np.float64] | None = np.full(shape, math.nan) if keep else None

    def add(self, first: int, values: NDArray[np.float64]) -> None:
        """Take the points from first on."""
        empty = ~np.isfinite(values).all(axis=1)
        if empty.any():
            if not self.empty:
                self._first_empty = first + int(np.argmax(empty))
            self.empty += int(empty.sum())
        self._low = np.fmin(self._low, np.fmin.reduce(values, axis=0))
        self._high = np.fmax(self._high, np.fmax.reduce(values, axis=0))
        if self.kept is not None:
            self.kept[first : first + len(values)] = values
        self.done = first + len(values)

    def complaint(self) -> str:
        """Return how many points have no value, and why the first has none."""
        return (
            f"{self.empty} of {self.done} points have an empty value; the first, "
            f"{self._sweep.why_empty(self._first_empty)}"
        )

    def summary(self) -> str:
        """Return a line for each metric."""
        rows = [f"{'points':<28} {self.done}"]
        for k, name in enumerate(self._sweep.metrics):
            unit = METRICS[name].unit
            if self._low[k] <= self._high[k]:
                rows.append(f"{name:<28} {self._low[k]:.6g} .. {self._high[k]:.6g} {unit}")
            else:
                rows.append(f"{name:<28} no value")
        return "\n".join(rows)

    def json(self) -> str:
        """Return one JSON object; a metric has the shape of the grid, null for no value."""
        if self.kept is None:
            raise ValueError("values were not kept")
        sweep = self._sweep
        grids = {}
        for k, name in enumerate(sweep.metrics):
            column = self.kept[:, k]
            filled = np.where(np.isfinite(column), column, None)  # type: ignore[call-overload]
            grids[name] = filled.reshape(sweep.shape).tolist()
        return json.dumps(
            {
                "vary": {a.name: a.values(np.arange(a.count)).tolist() for a in sweep.axes},
                "metrics": grids,
                "steps": sweep.steps,
                "empty": self.empty,
                "why_empty": self._sweep.why_empty(self._first_empty) if self.empty else None,
                "parameters": sweep.base.flat(),
            }
        )
