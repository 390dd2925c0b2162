# SPDX-License-Identifier: Apache-2.0
"""Steps and backsteps of a simulated run, and the means and errors of measured ones."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy  # its parts load when they are used, which takes half a second
from numpy.typing import NDArray

from stickslip_ros.model import Plant
from stickslip_ros.model.waveforms import command_of
from stickslip_ros.parameters import Parameters
from stickslip_ros.reporting import format_si
from stickslip_ros.solver.batch import backstep_into_rest
from stickslip_ros.solver.driven import simulation_of

#: Number of first steps from rest that differ from the settled ones and are left out of means; so
#: many steps are kept at least, or the second half of fewer than twice as many.
SETTLING, KEPT = 7, 4
#: A step is measurable from here on, m: ten times the accuracy that the model is solved to.
MEASURABLE = 1e-10
#: Steps from rest by which an operating point is judged.
TRIAL_STEPS = SETTLING + 5
_CHUNK = 10_000
#: Standard errors of a significant difference: 0.3 % of a normal distribution lie beyond.
COVERAGE = 3.0
#: So many settled values show their scatter by themselves. Of fewer, all but the first cycles of a
#: run do, which differ most.
_SHOW_SCATTER, _FIRST = 8, 3


@dataclass(frozen=True)
class MeasuredValue:
    """A value with its standard error; both nan where it cannot be determined."""

    value: float
    error: float


@dataclass(frozen=True)
class StepRun:
    """A run of steps from rest; lengths in m."""

    position: NDArray[np.float64]  #: at the end of each cycle, shape (steps,)
    step_size: float  #: mean over the settled steps, with the sign of the direction
    backstep: float  #: mean over the settled steps

    def __repr__(self) -> str:
        """Say the run in one line."""
        size, back = format_si(self.step_size, "m"), format_si(self.backstep, "m")
        return f"StepRun({len(self.position)} steps: {size} a step, backstep {back})"


def settled_from(steps: int) -> int:
    """Return how many of the first steps after a rest means leave out.

    The one rule for simulated and measured runs, for steps and for backsteps. A longer run keeps
    as many steps as a shorter one, or more.
    """
    return min(SETTLING, max(steps // 2, steps - KEPT))


def settled_mean(values: NDArray[np.float64]) -> Any:
    """Return the mean over the settled steps, those from `settled_from` on, along the last axis.

    values has shape (steps,) or (points, steps). nan values are left out; nan if nothing is left.
    """
    kept = values[..., settled_from(values.shape[-1]) :]
    finite = np.isfinite(kept)
    with np.errstate(invalid="ignore"):
        mean = np.where(finite, kept, 0.0).sum(axis=-1) / finite.sum(axis=-1)
    return mean if values.ndim > 1 else float(mean)


def estimate_settled_mean(values: NDArray[np.float64], exact: bool) -> MeasuredValue:
    """Return the mean of the settled values, (steps,), with the error that their scatter shows.

    Where few of them are settled, earlier ones show the scatter, too. Of exact values (without
    noise) it is no chance: a single one has no error.
    """
    kept, earlier = values[settled_from(len(values)) :], values[_FIRST:]
    kept, earlier = kept[np.isfinite(kept)], earlier[np.isfinite(earlier)]
    if not len(kept):
        return MeasuredValue(math.nan, math.nan)
    among = kept if exact or len(kept) >= _SHOW_SCATTER else max(kept, earlier, key=len)
    if len(among) < 2:
        return MeasuredValue(float(np.mean(kept)), 0.0 if exact else math.nan)
    error = float(np.std(among, ddof=1)) / math.sqrt(len(kept))
    if not exact:
        # `COVERAGE` of the widened ones hold the mean as often as those of a normal distribution do
        # (Student, Biometrika 6 (1908) 1).
        tail = scipy.special.ndtr(COVERAGE)
        error *= float(scipy.special.stdtrit(len(among) - 1, tail)) / COVERAGE
    return MeasuredValue(float(np.mean(kept)), error)


def run_steps(
    p: Parameters | Mapping[str, Any], steps: int, progress: Callable[[int], object] | None = None
) -> StepRun:
    """Run steps (sign: direction) from rest with the amplitude and frequency in p.

    A backstep runs into the rise of the next cycle; the last one, which runs into rest and is a
    little longer, counts only where it is the only one.
    progress is called every now and then with the number of steps added. Raises ParameterError.
    """
    p = Parameters.of(p)
    simulation = simulation_of(p, Plant.of(p))
    drive_cycle = command_of(p, 1 if steps >= 0 else -1)
    simulation.start(drive_cycle, abs(steps))
    position, backstep = np.empty(abs(steps)), np.empty(abs(steps))
    for first in range(0, abs(steps), _CHUNK):
        part = slice(first, min(first + _CHUNK, abs(steps)))
        cycles = simulation.run_cycles(part.stop - part.start)
        position[part], backstep[part] = cycles.position, cycles.backstep
        if progress is not None:
            progress(part.stop - part.start)
    if len(backstep) == 1:
        backstep = np.array([math.nan, backstep_into_rest(simulation)])
    return StepRun(
        position,
        step_size=settled_mean(np.diff(position, prepend=0.0)),
        backstep=settled_mean(backstep[1:]),  # each is known at the end of the cycle after it
    )
