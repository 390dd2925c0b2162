# SPDX-License-Identifier: Apache-2.0
"""Fills the buffers of plants and axes, and starts drive cycles."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.compiled import compiled
from stickslip_ros.laws import OWN_CONSTANTS
from stickslip_ros.model import Contact, Plant
from stickslip_ros.model.friction import DISTANCES
from stickslip_ros.model.plant import NEARLY_SLIDING
from stickslip_ros.solver.branches import settling, sliding_deflection, stribeck_edge
from stickslip_ros.solver.layout import (
    AXIS,
    AXIS_BUFFER,
    CONTACT,
    CONTACT_SIZE,
    PLANT,
    PLANT_SIZE,
    axis_in,
    contacts_in,
    open_record,
    plain_dtype,
    plant_in,
)
from stickslip_ros.solver.oscillator import oscillator

#: Largest tolerance, as share of the limit of z: it sets the accuracy of the friction
_FINEST = 1e-2


def pack_plant(plant: Plant, tolerance: float) -> NDArray[np.float64]:
    """Return the buffer of a plant; tolerance is the error in position (m) allowed per cycle."""
    buffer = np.zeros(PLANT_SIZE)
    record = open_record(buffer, PLANT)
    for name, number in zip(Contact._fields, plant.contact, strict=True):
        record[name] = number
    record["mass"], record["force"], record["spring"] = plant.mass, plant.force, plant.spring
    record["tolerance"] = tolerance
    derive_constants(buffer)
    return buffer


@compiled
def derive_constants(buffer: NDArray) -> None:
    """Fill the constants that follow from the inputs of a plant."""
    plant = plant_in(buffer)
    plant.tolerance = min(plant.tolerance, _FINEST * min(plant.z_k, plant.z_s))
    friction = plant.sigma_0 * min(plant.z_k, plant.z_s)
    load = max(plant.force, -plant.force)
    plant.slides = 1 if load > NEARLY_SLIDING * friction else 0
    plant.v_edge = stribeck_edge(plant)
    plant.z_slide = sliding_deflection(plant)
    kappa = (plant.sigma_0 + plant.spring) / plant.mass
    o = oscillator(0.5 * (plant.sigma_1 + plant.sigma_2) / plant.mass, kappa)
    plant.delta, plant.kappa, plant.omega = o
    plant.inv_omega = 1.0 / math.sqrt(kappa)
    plant.settling, plant.settled = settling(plant)


def contact_buffer(plant: Plant) -> NDArray[np.float64] | None:
    """Return an empty buffer for several contacts, see `layout.contacts_in`; None for one."""
    return np.zeros(2 * len(plant.contacts) * CONTACT_SIZE) if plant.contacts else None


def contact_records(buffer: NDArray[np.float64]) -> NDArray[Any]:
    """Return the records of several contacts in their buffer, for Python: fields by ["name"]."""
    return buffer[: len(buffer) // 2].view(plain_dtype(CONTACT))


def set_contacts(buffer: NDArray[np.float64] | None, plant: Plant) -> None:
    """Write the constants of a plant's contacts into their buffer, if there are several."""
    if buffer is None:
        return
    records = contact_records(buffer)
    for name, values in zip(Contact._fields, zip(*plant.contacts, strict=True), strict=True):
        records[name] = values
    for name, value in zip(OWN_CONSTANTS, plant.own, strict=True):
        records[name] = value


_NEVER_MOVED = np.zeros(AXIS_BUFFER)
for _name, _value in {
    **dict.fromkeys(("backstep", "last_step", "last_dissipated"), math.nan),
    **dict.fromkeys(("low", "near_low"), -math.inf),
    **dict.fromkeys(("high", "near_high"), math.inf),
    "replay": 1,
}.items():
    open_record(_NEVER_MOVED, AXIS)[_name] = _value


def at_rest(axis: NDArray[np.float64], contacts: NDArray[np.float64] | None) -> None:
    """Reset the buffers of an axis to rest at x = 0."""
    axis[:] = _NEVER_MOVED
    if contacts is not None:
        records = contact_records(contacts)
        for name in ("now_z", "cycle_z", "now_inner", "cycle_inner"):
            records[name] = 0.0


def set_clear_range(
    s: np.void,
    plant: NDArray[np.float64],
    contacts: NDArray[np.float64] | None,
    longest: float,
) -> None:
    """Set the range of positions from which an arc cannot reach a stop.

    An arc moves the runner by the longest segment of the drive (m) plus twice the deflection at
    most; s is the record of the axis, plant and contacts are buffers.
    """
    distances = Contact._fields[DISTANCES]
    deflections = [abs(s["now_z"]), *(open_record(plant, PLANT)[name] for name in distances)]
    if contacts is not None:
        deflections += [contact_records(contacts)[name].max() for name in distances]
    reach = longest + 2.0 * float(max(deflections))
    s["near_low"], s["near_high"] = s["low"] + reach, s["high"] - reach


@compiled
def begin_window(
    axis: NDArray, start: float, count: int, shift: float, slip: int, slip_end: int
) -> None:
    """Start count cycles at start (s) in the present state of an axis, which goes on as it is."""
    s = axis_in(axis).state
    s.start, s.count, s.shift, s.slip, s.slip_end = start, count, shift, slip, slip_end
    s.done = s.steady = s.segment = 0
    s.tau = s.since = s.open_tau = 0.0


@compiled
def begin_cycles(
    axis: NDArray,
    contacts: NDArray | None,
    t: float,
    count: int,
    cycle: tuple[float, int, int, int],
) -> None:
    """Start count drive cycles at time t (s) in the present state of an axis.

    cycle is how far it shifts u (m), the segments in which its slip begins and that follows it, and
    the sign of its step.
    """
    s = axis_in(axis).state
    s.start, s.level, s.count = t, s.now_u, count
    s.shift, s.slip, s.slip_end, s.sign = cycle
    s.tau = s.since = s.dissipated = 0.0
    s.x = s.cycle_x = s.x_min = s.x_max = s.now_x
    s.v = s.cycle_v = s.now_v
    s.z = s.cycle_z = s.z_min = s.z_max = s.now_z
    s.open_tau, s.open_x, s.open_v, s.open_z = 0.0, s.x, s.v, s.z
    s.impulse = 0.0
    s.tracking = s.now_tracking = s.now_segment = 0
    s.done = s.segment = s.steady = 0
    if contacts is not None:
        for c in contacts_in(contacts, False):
            c.z, c.inner = c.now_z, c.now_inner
