# SPDX-License-Identifier: Apache-2.0
"""A measured step to lay over the simulated one: the mean of the settled cycles of a run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.reporting.plots import thin_columns
from stickslip_ros.traces import TraceError
from stickslip_ros.traces.analysis import find_runs
from stickslip_ros.traces.motion import Motion
from stickslip_ros.traces.runs import main_run

Array = NDArray[np.float64]

#: Periods that a drawn step holds: a cycle, its slip, and the ringing after it.
SPAN = 1.25
#: Places in a step at which the cycles are put together, at most; points that are drawn.
_GRID, _SHOWN = 10_000, 700


@dataclass(frozen=True)
class Overlay:
    """The mean settled step of the longest run in a measurement."""

    source: str
    frequency: float  #: of the drive, Hz
    direction: int  #: +1 or -1
    steps: int  #: of the run
    step_size: float  #: m, with the sign of the direction
    step_error: float  #: its standard error, m
    t: Array  #: since the start of the cycle, s, shape (places,)
    x: Array  #: m, shape (places,)
    motion: Motion  #: the whole measurement

    @classmethod
    def of(cls, motion: Motion, frequency: float | None = None) -> Overlay:
        """Return the overlay of a measurement; frequency (Hz): of the drive, if it is known.

        Raises TraceError where the measurement shows no steps.
        """
        runs = find_runs(motion.t, motion.x, None if frequency is None else 1.0 / frequency)
        try:
            run = main_run(runs)
        except TraceError:
            raise TraceError(f"no steps are found in {motion.source}") from None
        starts = run.starts
        period = run.period
        per_cycle = int(np.searchsorted(motion.t, starts[0] + period)) - int(
            np.searchsorted(motion.t, starts[0])
        )
        grid = np.linspace(0.0, SPAN * period, int(np.clip(SPAN * per_cycle, 16, _GRID)))
        # Without the last cycle, which no other follows.
        kept = [s for s in starts[:-1] if motion.t[0] <= s and s + grid[-1] <= motion.t[-1]]
        kept = kept[min(run.first_cycle, len(kept) - 1) :] if kept else []
        if not kept:
            raise TraceError(f"{motion.source} shows no whole drive cycle")
        laid = [np.interp(s + grid, motion.t, motion.x) for s in kept]
        mean = np.mean([one - one.mean() for one in laid], axis=0)
        return cls(
            motion.source, run.frequency, run.direction, run.steps,
            run.step_size, run.step_size_error, grid, mean, motion,
        )  # fmt: skip

    def laid_over(self, t: Array, x: Array, window: tuple[float, float]) -> tuple[Array, Array]:
        """Return times (s) and positions (m) at the level of a simulated step, within a window.

        t (s) and x (m), shape (samples,), are those of the simulated step. The zero of a sensor
        means nothing, so the level is that of the least squares.
        """
        level = float(np.mean(np.interp(self.t, t, x) - self.x))
        kept = (self.t >= window[0]) & (self.t <= window[1])
        at, laid = thin_columns(self.t[kept], self.x[kept] + level, count=_SHOWN)
        return at, laid
