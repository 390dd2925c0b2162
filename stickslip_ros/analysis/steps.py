# SPDX-License-Identifier: Apache-2.0
"""What a run of steps says: step size, backstep, 0-amplitude."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.model import drive_of, plant_of
from stickslip_ros.parameters import Values
from stickslip_ros.solver import Simulation

#: Steps from rest that still differ from the later ones and are left out of means.
SETTLING = 7
#: A step is measurable from here on, m: ten times the accuracy that the model is solved to.
MEASURABLE = 1e-10
#: Steps by which a 0-amplitude is judged, and its accuracy, m.
_TRIAL_STEPS, _RESOLUTION = SETTLING + 5, 1e-11
_CHUNK = 10_000


@dataclass(frozen=True)
class StepRun:
    """A run of steps from rest; lengths in m."""

    position: NDArray[np.float64]  #: at the end of each cycle, shape (steps,)
    step_size: float  #: mean over the settled steps, with the sign of the direction
    backstep: float  #: mean over the settled steps


def settled_mean(values: NDArray[np.float64]) -> float:
    """Return the mean of values, shape (steps,), without the first `SETTLING`, if more are there.

    nan values are left out; nan if nothing is left.
    """
    kept = values[SETTLING:] if len(values) > SETTLING else values[-1:]
    kept = kept[np.isfinite(kept)]
    return float(kept.mean()) if len(kept) else math.nan


def run_steps(p: Values, steps: int, progress: Callable[[int], object] | None = None) -> StepRun:
    """Run steps (sign: direction) from rest with the amplitude and frequency in p.

    After the last cycle the axis rests for one period more, which ends the last backstep.
    progress is told every now and then how many steps were added. Raises ParameterError.
    """
    simulation = Simulation(plant_of(p), p["tolerance"])
    pattern = drive_of(p, 1 if steps >= 0 else -1)
    simulation.start(pattern, abs(steps))
    position, backstep = np.empty(abs(steps)), np.empty(abs(steps))
    for first in range(0, abs(steps), _CHUNK):
        part = slice(first, min(first + _CHUNK, abs(steps)))
        cycles = simulation.run_cycles(part.stop - part.start)
        position[part], backstep[part] = cycles.position, cycles.backstep
        if progress is not None:
            progress(part.stop - part.start)
    ringing = simulation.plant.ringing_frequency
    simulation.advance(
        simulation.end_of_move + max(pattern.period, 1.0 / ringing if ringing else 0.0)
    )
    return StepRun(
        position,
        step_size=settled_mean(np.diff(position, prepend=0.0)),
        backstep=settled_mean(np.append(backstep[1:], simulation.backstep)),
    )


def zero_amplitude(p: Values) -> float | None:
    """Return the 0-amplitude (m of actuator deflection), directly: where steps vanish.

    Bisection for the largest amplitude whose step stays below `MEASURABLE`, at the frequency and
    slewrate of p; None if the axis does not step even at the largest amplitude.
    """

    def steps_at(volts: float) -> bool:
        run = run_steps({**p, "amplitude": volts}, _TRIAL_STEPS)
        return abs(run.step_size) >= MEASURABLE

    fastest = p["slewrate"] * 1e6 / p["frequency"]
    low, high = 0.0, min(p["max_voltage"], 0.999 * fastest)
    if not steps_at(high):
        return None
    while (high - low) * p["gain"] > _RESOLUTION:
        middle = 0.5 * (low + high)
        if steps_at(middle):
            high = middle
        else:
            low = middle
    return float(high * p["gain"])
