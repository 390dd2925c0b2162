# SPDX-License-Identifier: Apache-2.0
"""Steps and backsteps of a simulated run."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.base.reporting import format_si
from stickslip_ros.physics.model import Plant
from stickslip_ros.physics.model.waveforms import command_of
from stickslip_ros.physics.parameters import Parameters
from stickslip_ros.physics.solver.driven import simulation_of
from stickslip_ros.physics.solver.simulation import backstep_into_rest
from stickslip_ros.simulation.settled import settled_mean

_CHUNK = 10_000
#: Change of the start (m): the error that a cycle may have, far below all that is measured; and the
#: most cycles that are judged
PUSHED, _MOST_JUDGED = 1e-11, 1000
#: Times that a change of the start may grow within a run before the run is one of many
UNSTABLE = 100.0


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


def growth_of(p: Parameters, steps: int, position: NDArray[np.float64]) -> float:
    """Return how many times a small change of the start grows within a run of steps from rest.

    position is that of the run at the ends of its cycles, m, shape (steps,).

    Up to about 1 where contact and damping hold the runner; of a run that is unstable by nature
    more than `UNSTABLE`, so that it is one of many that begin alike. Raises ParameterError.
    """
    count = min(abs(steps), _MOST_JUDGED)
    simulation = simulation_of(p, Plant.of(p))
    simulation.push(PUSHED)
    simulation.start(command_of(p, 1 if steps >= 0 else -1), count)
    apart = simulation.run_cycles(count).position - position[:count]
    return float(np.abs(apart).max() / PUSHED)


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
