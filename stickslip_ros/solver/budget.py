# SPDX-License-Identifier: Apache-2.0
"""How much work a call may take, and the error of one that takes more.

The kernel runs in slices of a few milliseconds, with the interpreter between them: so Ctrl-C and
other signals get through, whatever the kernel does.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.errors import StickslipError
from stickslip_ros.solver.advance import advance, find_events, sample
from stickslip_ros.solver.layout import PLANT, open_record

#: Arcs in a slice: about a microsecond each, some tens of them where series are short
SLICE = 2_000
#: Samples in a slice: up to a microsecond each
SAMPLES = 20_000
#: Arcs that a cycle may take; those of the paper take tens to hundreds
PER_CYCLE = 500_000


class SolverError(StickslipError, ArithmeticError):
    """The solver failed, or exceeded its budget; the message names the cause."""


class KernelBuffers(NamedTuple):
    """The buffers of the kernel."""

    plant: NDArray[np.float64]  #: of `plants.pack_plant`
    axis: NDArray[np.float64]  #: of size `layout.AXIS_BUFFER`
    contacts: NDArray[np.float64] | None  #: of `plants.contact_buffer`
    drive: NDArray[np.float64]  #: of a cycle, see `event_loop`, (3, segments)


def run(
    buffers: KernelBuffers,
    state: np.void,
    until: tuple[float, int],
    rows: NDArray[np.float64],
    budget: int = PER_CYCLE,
) -> None:
    """Call `advance.advance` in slices; until is t_end (s) and stop_cycle.

    state is the record of the axis, from `layout.open_record`; budget is in arcs.

    Raises SolverError if a cycle, or the time from the last cycle to t_end, exceeds the budget.
    """
    left, state["previewing"] = budget, 0
    while left > 0:
        state["spent"], state["allowance"] = 0, SLICE
        state["t_end"], state["stop_cycle"] = until
        ended = advance(*buffers, rows)
        if not state["unfinished"]:
            return
        rows = rows[ended:]
        left = budget if ended else left - SLICE
    raise SolverError(_over_budget(open_record(buffers.plant, PLANT), budget))


def run_samples(
    buffers: KernelBuffers, state: np.void, times: NDArray[np.float64], samples: NDArray[np.float64]
) -> None:
    """Call `advance.sample` in slices. Raises SolverError like `run`."""
    state["previewing"] = 0
    while len(times):
        for _ in _slices(buffers, state):
            filled = sample(*buffers, times[:SAMPLES], samples)
            times, samples = times[filled:], samples[filled:]
            if filled:
                break


def run_events(
    buffers: KernelBuffers, state: np.void, until: tuple[float, int]
) -> list[NDArray[np.float64]]:
    """Call `advance.find_events` in slices; return the times (s) in parts.

    until is t_end (s) and stop_cycle. Raises SolverError like `run`.
    """
    parts: list[NDArray[np.float64]] = []
    state["t_end"], state["stop_cycle"] = until
    for _ in _slices(buffers, state):
        times = np.empty(SLICE)
        parts.append(times[: find_events(*buffers, times)])
    return parts


def _slices(buffers: KernelBuffers, state: np.void) -> Iterator[None]:
    """Yield with an allowance for each slice until one finishes all; SolverError like `run`."""
    left, done = PER_CYCLE, int(state["done"])
    while left > 0:
        state["spent"], state["allowance"] = 0, SLICE
        yield
        if not state["unfinished"]:
            return
        left = PER_CYCLE if state["done"] > done else left - SLICE
        done = int(state["done"])
    raise SolverError(_over_budget(open_record(buffers.plant, PLANT), PER_CYCLE))


def _over_budget(plant: Any, budget: int) -> str:
    """Return the error message for a plant that exceeds its arc budget."""
    mass, force = float(plant["mass"]), float(plant["force"])
    friction = float(plant["sigma_0"]) * min(float(plant["z_k"]), float(plant["z_s"]))
    if plant["slides"]:
        return (
            f"a cycle takes more than the {budget} arcs that the solver may spend on it: the load "
            f"of {force:g} N may carry the runner off, for the friction is {friction:g} N; lower "
            "the load or raise the preload"
        )
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
