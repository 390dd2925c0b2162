# SPDX-License-Identifier: Apache-2.0
"""The buffers of plants and axes, filled by name, and an axis that starts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.compiled import compiled
from stickslip_ros.model.plant import CONTACT_INPUTS, PLANT_INPUTS
from stickslip_ros.solver.branches import settling, sliding_deflection, stribeck_edge
from stickslip_ros.solver.layout import (
    AXIS,
    CONTACT,
    CONTACT_SIZE,
    PLANT,
    PLANT_SIZE,
    opened,
    plant_in,
)
from stickslip_ros.solver.oscillator import oscillator

#: The tolerance is at most this share of the limit of z: it says how well the friction is known
_FINEST = 1e-2
#: Share of the friction above which a load counts as one that may keep the runner sliding
_NEARLY = 0.5


def prepared(numbers: Sequence[float], tolerance: float) -> NDArray[np.float64]:
    """Return the buffer of a plant of numbers in the order of PLANT_INPUTS.

    tolerance is the error in position (m) allowed per cycle.
    """
    buffer = np.zeros(PLANT_SIZE)
    plant = opened(buffer, PLANT)
    for name, number in zip(PLANT_INPUTS, numbers, strict=True):
        plant[name] = number
    plant["tolerance"] = tolerance
    derive(buffer)
    return buffer


@compiled
def derive(buffer: NDArray) -> None:
    """Fill what follows from the inputs of a plant."""
    plant = plant_in(buffer)
    plant.tolerance = min(plant.tolerance, _FINEST * min(plant.z_k, plant.z_s))
    friction = plant.sigma_0 * min(plant.z_k, plant.z_s)
    load = max(plant.force, -plant.force)
    plant.slides = 1 if load > _NEARLY * friction else 0
    plant.v_edge = stribeck_edge(plant)
    plant.z_slide = sliding_deflection(plant)
    kappa = (plant.sigma_0 + plant.spring) / plant.mass
    o = oscillator(0.5 * (plant.sigma_1 + plant.sigma_2) / plant.mass, kappa)
    plant.delta, plant.kappa, plant.omega = o
    plant.inv_omega = 1.0 / math.sqrt(kappa)
    plant.settling, plant.settled = settling(plant)


def contact_buffer(contacts: int) -> NDArray[np.float64] | None:
    """Return an empty buffer of several contacts, see `layout.contacts_in`; None for one (0)."""
    return np.zeros(2 * contacts * CONTACT_SIZE) if contacts else None


def contact_records(buffer: NDArray[np.float64]) -> NDArray[Any]:
    """Return the records of several contacts in their buffer, for Python: fields by ["name"]."""
    plain = np.dtype([(name, CONTACT[name]) for name in CONTACT.names or ()])
    return buffer[: len(buffer) // 2].view(plain)


def set_constants(buffer: NDArray[np.float64], contacts: Sequence[Sequence[float]]) -> None:
    """Let contacts have these constants, each in the order of CONTACT_INPUTS."""
    records = contact_records(buffer)
    for name, values in zip(CONTACT_INPUTS, zip(*contacts, strict=True), strict=True):
        records[name] = values


def at_rest(axis: NDArray[np.float64], contacts: NDArray[np.float64] | None) -> None:
    """Set the buffers of an axis to one that never moved."""
    axis[:] = 0.0
    s = opened(axis, AXIS)
    for name in ("backstep", "last_step", "last_dissipated"):
        s[name] = math.nan
    for name in ("low", "near_low"):
        s[name] = -math.inf
    for name in ("high", "near_high"):
        s[name] = math.inf
    s["replay"] = 1
    if contacts is not None:
        records = contact_records(contacts)
        for name in ("now_z", "cycle_z", "now_inner", "cycle_inner"):
            records[name] = 0.0


def begin(
    s: np.void,
    contacts: NDArray[np.float64] | None,
    t: float,
    cycles: tuple[int, float],
    slip: tuple[int, int, int],
) -> None:
    """Start drive cycles at time t (s), from the state asked for last.

    cycles are how many, and what u gains over each (m); slip is the segment in which the slip
    begins, the one that follows it, and the direction of the step. s is the state, opened.
    """
    s["start"], s["level"] = t, s["now_u"]
    s["count"], s["shift"] = cycles
    s["slip"], s["slip_end"], s["sign"] = slip
    for name in ("tau", "since", "dissipated", "open_tau", "impulse"):
        s[name] = 0.0
    for name in ("x", "v", "z"):
        s[name] = s[f"open_{name}"] = s[f"cycle_{name}"] = s[f"now_{name}"]
    s["x_min"] = s["x_max"] = s["x"]
    s["z_min"] = s["z_max"] = s["z"]
    for name in ("tracking", "now_tracking", "now_segment", "done", "segment", "steady"):
        s[name] = 0
    if contacts is not None:
        records = contact_records(contacts)
        records["z"], records["inner"] = records["now_z"], records["now_inner"]
