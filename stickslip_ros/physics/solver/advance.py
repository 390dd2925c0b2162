# SPDX-License-Identifier: Apache-2.0
"""What Python calls of the kernel: advance to one time, or to many, within a budget of arcs.

``contacts`` is None for a runner on one contact, else the buffer for `layout.contacts_in`. If the
allowance of arcs runs out, a call of the kernel returns with ``unfinished`` set and is made again:
so it runs in slices of a few milliseconds, with the interpreter between them, and Ctrl-C and other
signals get through, whatever the kernel does.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.base.arrays import Array
from stickslip_ros.base.compiled import compiled
from stickslip_ros.base.errors import StickslipError
from stickslip_ros.physics.solver.arc_dispatch import friction_at
from stickslip_ros.physics.solver.arc_motion import turns_within
from stickslip_ros.physics.solver.event_loop import (
    friction_work_since,
    open_account,
    period_of,
    repeat,
    solve_cycles,
    stays_clear,
    write_row,
)
from stickslip_ros.physics.solver.layout import (
    PLANT,
    ROW_SIZE,
    Fields,
    contacts_in,
    kernel_in,
    open_record,
    plant_in,
)

#: Numbers of each sample: x (m), v (m/s), z (m), u' (m/s), u (m), F (N); for several contacts
#: followed by z (m) of each
SAMPLE_SIZE = 6
#: Largest number of events of one arc
_LEAST_ROOM = 64
#: More cycles than any run can have
ENDLESS = np.iinfo(np.int64).max
#: Arcs in a slice: about a microsecond each, some tens of them where series are short
SLICE = 2_000
#: Samples in a slice: up to a microsecond each
SAMPLES = 20_000
#: Arcs that a cycle may take; those of the paper take tens to hundreds
PER_CYCLE = 500_000


@compiled
def advance(
    plant: NDArray, axis: NDArray, contacts: NDArray | None, drive: NDArray, rows: NDArray
) -> int:
    """Advance to t_end (s) or to the end of stop_cycle of the request, whichever comes first.

    rows (cycles, ROW_SIZE) receives the results of the cycles that end; results without a row are
    dropped. Returns the number of cycles that ended.

    With ``replay``, a cycle that begins as the last one did is not solved again. With ``cut``,
    t_end becomes an event; call `anchor` afterwards.
    """
    kernel, each, ahead = kernel_in(axis), contacts_in(contacts, False), contacts_in(contacts, True)
    kernel.arc.holds = 0
    return _run_drive(plant_in(plant), kernel, each, ahead, drive, rows)


@compiled
def _run_drive(
    plant: np.record,
    kernel: np.record,
    contacts: NDArray | None,
    ahead: NDArray | None,
    drive: NDArray,
    rows: NDArray,
) -> int:
    """Advance as `advance`, but along the arc that was found last, if it still holds.

    ahead are the copies of the contacts for a preview.
    """
    s, request = kernel.state, kernel.request
    request.unfinished = 0
    if request.cut or not request.replay:
        return solve_cycles(plant, s, kernel, contacts, drive, rows)
    stop_cycle, period = request.stop_cycle, period_of(drive)
    ended = 0
    while s.done < min(s.count, stop_cycle):
        if s.steady and not stays_clear(s, kernel.stops):
            s.steady = kernel.arc.holds = 0
        if s.steady:
            if (request.t_end - s.start) - s.done * period < period:
                if not request.previewing:
                    kernel.preview, kernel.arc.holds = s, 0
                    if contacts is not None and ahead is not None:
                        for i in range(len(contacts)):
                            ahead[i] = contacts[i]
                _preview(plant, kernel, contacts, ahead, drive, rows)
                return ended
            if request.spent >= request.allowance:
                request.unfinished = 1
                return ended
            request.spent += 1
            repeat(s)
            kernel.arc.holds = 0
            write_row(s, rows, ended)
            ended += 1
            continue
        request.stop_cycle = s.done + 1
        if not solve_cycles(plant, s, kernel, contacts, drive, rows[ended:]):
            return ended
        ended += 1
    request.stop_cycle = stop_cycle
    return ended + solve_cycles(plant, s, kernel, contacts, drive, rows[ended:])


@compiled
def _preview(
    plant: np.record,
    kernel: np.record,
    contacts: NDArray | None,
    ahead: NDArray | None,
    drive: NDArray,
    rows: NDArray,
) -> None:
    """Find the state at t_end within a repeated cycle, on a copy of the state.

    So the next cycle will begin as this one did. The copy is fresh, or continues from the last
    preview of the cycle, which was for an earlier time. No cycle ends in it, so rows stay as they
    are.
    """
    s, copy, request = kernel.state, kernel.preview, kernel.request
    request.stop_cycle, request.unfinished = s.done + 1, 0
    solve_cycles(plant, copy, kernel, ahead, drive, rows[:0])
    s.now_x, s.now_v, s.now_z = copy.now_x, copy.now_v, copy.now_z
    s.now_rate, s.now_u = copy.now_rate, copy.now_u
    s.now_segment, s.now_tracking = copy.now_segment, copy.now_tracking
    request.previewing = request.unfinished
    if contacts is not None and ahead is not None:
        for i in range(len(contacts)):
            contacts[i].now_z, contacts[i].now_second = ahead[i].now_z, ahead[i].now_second


@compiled
def sample(
    plant: NDArray,
    axis: NDArray,
    contacts: NDArray | None,
    drive: NDArray,
    times: NDArray,
    samples: NDArray,
) -> int:
    """Advance to each of the times (s), rising; fill samples (times, SAMPLE_SIZE or more).

    Returns how many samples are filled: fewer if the allowance of arcs ran out.
    """
    moved, kernel = plant_in(plant), kernel_in(axis)
    each, ahead = contacts_in(contacts, False), contacts_in(contacts, True)
    rows, period = np.empty((0, ROW_SIZE)), period_of(drive)
    s, request = kernel.state, kernel.request
    kernel.arc.holds = 0
    previewing = False  # within a repeated cycle, whose preview continues
    for k in range(len(times)):
        request.t_end, request.stop_cycle = times[k], ENDLESS
        if previewing and (times[k] - s.start) - s.done * period < period:
            _preview(moved, kernel, each, ahead, drive, rows)
        else:
            _run_drive(moved, kernel, each, ahead, drive, rows)
            previewing = s.steady != 0 and s.done < s.count
        if request.unfinished:
            return k
        kept = samples[k]
        kept[0], kept[1], kept[2] = s.now_x, s.now_v, s.now_z
        kept[3], kept[4] = s.now_rate, s.now_u
        kept[5] = friction_at(s.now_z, s.now_v - s.now_rate, moved, each)
        if contacts is not None:
            for i in range(len(each)):
                kept[SAMPLE_SIZE + i] = each[i].now_z
    return len(times)


@compiled
def friction(plant: NDArray, axis: NDArray, contacts: NDArray | None) -> float:
    """Return F (N) of Eq. 1 at the time advanced to."""
    s = kernel_in(axis).state
    w = s.now_v - s.now_rate
    return friction_at(s.now_z, w, plant_in(plant), contacts_in(contacts, False))


@compiled
def find_events(
    plant: NDArray, axis: NDArray, contacts: NDArray | None, drive: NDArray, times: NDArray
) -> int:
    """Advance like `advance`, arc by arc; write the times (s) of ends and turns of the arcs.

    Returns the number of times written; unfinished if times is full. Tables are not used, because
    they would skip events.
    """
    kernel, moved, each = kernel_in(axis), plant_in(plant), contacts_in(contacts, False)
    s, arc, request = kernel.state, kernel.arc, kernel.request
    arc.holds = 0
    period, rows, found = period_of(drive), np.empty((0, ROW_SIZE)), 0
    moved.precomputed = -1
    while True:
        if found > len(times) - _LEAST_ROOM:
            request.unfinished = 1
            return found
        begun = s.start + s.done * period + s.since + s.tau
        request.spent, request.allowance, request.unfinished = 0, 1, 0
        solve_cycles(moved, s, kernel, each, drive, rows)
        h = min(arc.length, request.t_end - begun)
        if request.spent > 0 and 0.0 < h < math.inf:
            moving = kernel.held if s.stopped != 0 else moved
            turns = turns_within(arc, moving, h, times[found:-1])
            times[found : found + turns] += begun
            found += turns
        if not request.unfinished:
            return found
        times[found] = begun + arc.length
        found += 1


@compiled
def anchor(plant: NDArray, axis: NDArray, x: float, v: float, z: float) -> None:
    """Make the time at which `advance` was cut an event, after which the plant may change.

    x (m), v (m/s), z (m) is the state at that time. It stays the same to the last bit; extremes,
    backstep and energy balance are updated.
    """
    kernel = kernel_in(axis)
    s = kernel.state
    kernel.request.cut, s.steady = 0, 0
    s.cycle_z = math.nan  # a cycle with two plants is not repeated
    s.x, s.v, s.z = s.now_x, s.now_v, s.now_z = x, v, z
    s.rate = s.now_rate
    s.friction_work += friction_work_since(s, plant_in(plant), s.tau - s.open_tau)
    open_account(s)


class SolverError(StickslipError, ArithmeticError):
    """The solver failed, or exceeded its budget; the message names the cause."""


class KernelBuffers(NamedTuple):
    """The buffers of the kernel."""

    plant: Array  #: of `plants.pack_plant`
    axis: Array  #: of size `layout.KERNEL_SIZE`
    contacts: Array | None  #: of `plants.contact_buffer`
    drive: Array  #: of a cycle, see `event_loop`, (3, segments)


def run(
    buffers: KernelBuffers,
    state: Fields,
    until: tuple[float, int],
    rows: Array,
    budget: int = PER_CYCLE,
) -> None:
    """Call `advance` in slices; until is t_end (s) and stop_cycle.

    state has the fields of the axis; budget is in arcs.

    Raises SolverError if a cycle, or the time from the last cycle to t_end, exceeds the budget.
    """
    state["previewing"], state["spent"], state["allowance"] = 0, 0, SLICE
    state["t_end"], state["stop_cycle"] = until
    done = state["done"]
    advance(*buffers, rows)
    if state["unfinished"]:  # hardly ever
        finish(buffers, state, until, rows, done, budget)


def finish(
    buffers: KernelBuffers,
    state: Fields,
    until: tuple[float, int],
    rows: Array,
    done: int,
    budget: int = PER_CYCLE,
) -> None:
    """Go on with a call of `advance` that its allowance has ended; arguments as of `run`.

    done: cycles that had ended before that call. Raises SolverError like `run`.
    """
    for _ in _slices(buffers, state, budget, SLICE if state["done"] == done else 0):
        state["t_end"], state["stop_cycle"] = until  # it leaves that of the cycle under way
        advance(*buffers, rows[state["done"] - done :])


def run_samples(buffers: KernelBuffers, state: Fields, times: Array, samples: Array) -> None:
    """Call `sample` in slices. Raises SolverError like `run`."""
    state["previewing"] = 0
    while len(times):
        for _ in _slices(buffers, state):
            filled = sample(*buffers, times[:SAMPLES], samples)
            times, samples = times[filled:], samples[filled:]
            if filled:
                break


def run_events(buffers: KernelBuffers, state: Fields, until: tuple[float, int]) -> list[Array]:
    """Call `find_events` in slices; return the times (s) in parts.

    until is t_end (s) and stop_cycle. Raises SolverError like `run`.
    """
    parts: list[Array] = []
    state["t_end"], state["stop_cycle"] = until
    for _ in _slices(buffers, state):
        times = np.empty(SLICE)
        parts.append(times[: find_events(*buffers, times)])
    return parts


def _slices(
    buffers: KernelBuffers, state: Fields, budget: int = PER_CYCLE, spent: int = 0
) -> Iterator[None]:
    """Yield with an allowance for each slice until one finishes all; SolverError like `run`.

    spent: arcs that the present cycle has taken of its budget.
    """
    left, done = budget - spent, int(state["done"])
    while left > 0:
        state["spent"], state["allowance"] = 0, SLICE
        yield
        if not state["unfinished"]:
            return
        left = budget if state["done"] > done else left - SLICE
        done = int(state["done"])
    raise SolverError(_over_budget(open_record(buffers.plant, PLANT), budget))


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
