# SPDX-License-Identifier: Apache-2.0
"""The phases of a step (Fig. 1) and the points between them (Fig. 2)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from stickslip_ros.physics.model import Contact, DriveCycle
    from stickslip_ros.physics.solver import Simulation
    from stickslip_ros.simulation.trace import Trace

REST, PRESLIDING, STICK, SLOWDOWN, PRESLIDING_BACK, SLIP, SLOWDOWN_BACK = (
    "rest",
    "presliding 1",
    "stick",
    "slowdown 1",
    "presliding 2",
    "slip",
    "slowdown 2",
)


def regime_now(simulation: Simulation) -> str:
    """Return "elastic", "mixed" or "plastic": how the contact deforms at the present time.

    Several contacts are mixed while some slide and others stick.
    """
    alpha = simulation.alpha
    return "elastic" if alpha == 0.0 else "plastic" if alpha == 1.0 else "mixed"


def phase_now(simulation: Simulation) -> str:
    """Return the phase of the step at the present time, one of the seven of Fig. 1."""
    state = simulation.state
    if simulation.cycles_left == 0:
        return SLOWDOWN_BACK if simulation.stepping_back else REST
    if simulation.slipping:
        if state.z * state.w < 0.0:
            return SLOWDOWN
        return PRESLIDING_BACK if regime_now(simulation) == "elastic" else SLIP
    if simulation.stepping_back:
        return SLOWDOWN_BACK
    started = simulation.cycles_done > 0 or abs(state.v) >= abs(state.rate)
    return STICK if started else PRESLIDING


def points(trace: Trace, drive_cycle: DriveCycle, contact: Contact, cycle: int) -> dict[str, float]:
    """Return the times (s) of the points A to F of Fig. 2 in one cycle of a trace.

    A: the cycle begins. B: the runner has become as fast as the actuator. C: the slip begins.
    D: the contact, bent the other way, breaks away. E: lowest point of the backstep. F: the
    asperities have unbent, the runner rings from here on. nan where a point does not occur; E and
    F may lie in the next cycle.
    """
    start = cycle * drive_cycle.period
    slip = start + float(np.sum(drive_cycle.durations[: drive_cycle.slip]))
    end = slip + drive_cycle.slip_duration
    sign = drive_cycle.sign
    t = trace.t
    found = {"A": start, "C": slip}
    found["B"] = _first(t, (t > start) & (t < slip) & (sign * trace.w >= 0.0))
    broken = (t > slip) & (t <= end) & (sign * trace.z >= contact.z_ba)
    found["D"] = _first(t, broken)
    after = t >= slip
    back = after & (sign * trace.v < 0.0)
    turned = _first(t, back)
    up = (t > turned) & (sign * trace.v >= 0.0)
    over = after & (t <= _first(t, up & (t >= end)))  # a slip in parts may turn it more than once
    lowest = _first(t, up & (t >= t[np.argmin(np.where(over, sign * trace.x, np.inf))]))
    found["E"] = _standstill(trace, lowest)
    found["F"] = _first(t, (t > lowest) & (sign * trace.z >= 0.0))
    return dict(sorted(found.items()))


def _standstill(trace: Trace, after: float) -> float:
    """Return when (s) the runner stands still between a sample, at time after, and the last one."""
    at = int(np.searchsorted(trace.t, after))
    if math.isnan(after) or at == 0 or trace.v[at] * trace.v[at - 1] >= 0.0:
        return after
    part = trace.v[at] / (trace.v[at] - trace.v[at - 1])
    return float(after - part * (after - trace.t[at - 1]))


def _first(t: np.ndarray, where: np.ndarray) -> float:
    return float(t[np.argmax(where)]) if where.any() else math.nan
