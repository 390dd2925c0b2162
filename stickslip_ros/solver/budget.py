# SPDX-License-Identifier: Apache-2.0
"""How much work a call may take, and what is said where it takes more.

The kernel runs in slices of a fraction of a second, with the interpreter between them: so Ctrl-C
and other signals get through, whatever the kernel does.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.errors import StickslipError
from stickslip_ros.solver.contacts import advance_contacts, sample_contacts
from stickslip_ros.solver.integrator import advance
from stickslip_ros.solver.layout import PLANT, PLANT_SIZE, opened
from stickslip_ros.solver.sampling import sample

#: Arcs in a slice; an arc takes about a microsecond, in the worst case tens of them
SLICE = 10_000
#: Arcs that a cycle may take; those of the paper take tens to hundreds
PER_CYCLE = 500_000


class SolverError(StickslipError, ArithmeticError):
    """The solver cannot go on, or not within its budget; the message names the cause."""


def run(
    plant: NDArray[np.float64],
    axis: NDArray[np.float64],
    state: np.void,
    drive: NDArray[np.float64],
    until: tuple[float, int],
    rows: NDArray[np.float64],
    budget: int = PER_CYCLE,
) -> None:
    """Do what `integrator.advance` does, slice by slice; until is t_end (s) and stop_cycle.

    state is the record of axis, `layout.opened`; budget is in arcs.

    Raises SolverError where a cycle, or the time from one to t_end, takes more than its budget.
    """
    left = budget
    kernel = advance if len(plant) == PLANT_SIZE else advance_contacts
    while True:
        state["spent"], state["allowance"] = 0, SLICE
        ended = kernel(plant, axis, drive, *until, rows)
        if not state["unfinished"]:
            return
        rows = rows[ended:]
        left = budget if ended else left - SLICE
        if left <= 0:
            raise SolverError(_over_budget(opened(plant, PLANT), budget))


def run_samples(
    plant: NDArray[np.float64],
    axis: NDArray[np.float64],
    state: np.void,
    drive: NDArray[np.float64],
    times: NDArray[np.float64],
    samples: NDArray[np.float64],
) -> None:
    """Do what `sampling.sample` does, slice by slice. Raises SolverError as `run` does."""
    left, first = PER_CYCLE, 0
    kernel = sample if len(plant) == PLANT_SIZE else sample_contacts
    while first < len(times):
        state["spent"], state["allowance"] = 0, SLICE
        filled = kernel(plant, axis, drive, times, samples, first)
        left = PER_CYCLE if filled > first else left - SLICE
        first = filled
        if left <= 0:
            raise SolverError(_over_budget(opened(plant, PLANT), PER_CYCLE))


def _over_budget(plant: Any, budget: int) -> str:
    """Return what is to be said of a plant of which a cycle takes more than its budget."""
    mass = float(plant["mass"])
    rates = {
        "sigma_1 / mass": float(plant["sigma_1"]) / mass,
        "sigma_2 / mass": float(plant["sigma_2"]) / mass,
        "sqrt(sigma_0 / mass)": math.sqrt(float(plant["sigma_0"]) / mass),
    }
    name = max(rates, key=lambda key: rates[key])
    return (
        f"a cycle takes more than the {budget} arcs that the solver may spend on it; the "
        f"fastest time of the axis is {1.0 / rates[name]:.3g} s ({name} is {rates[name]:.3g} 1/s): "
        "lower that, or raise the frequency or the tolerance"
    )
