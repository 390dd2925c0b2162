# SPDX-License-Identifier: Apache-2.0
"""Fills the buffers of plants and axes and their tables, and starts drive cycles."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.base.arrays import Array
from stickslip_ros.base.compiled import compiled
from stickslip_ros.physics.laws import OWN_CONSTANTS
from stickslip_ros.physics.laws.law import ALWAYS_PLASTIC, DISTANCES, ELASTOPLASTIC
from stickslip_ros.physics.model import Contact, Plant
from stickslip_ros.physics.model.plant import NEARLY_SLIDING
from stickslip_ros.physics.solver.branches import approach, sliding_deflection, stribeck_edge
from stickslip_ros.physics.solver.layout import (
    CONTACT_RECORD,
    CONTACT_SIZE,
    KERNEL_SIZE,
    NODES,
    ORDER,
    PLANT,
    PLANT_SIZE,
    ROWS,
    SLIDE_SIZE,
    Fields,
    contacts_in,
    kernel_in,
    open_record,
    plain_dtype,
    plant_in,
)
from stickslip_ros.physics.solver.oscillator import oscillator
from stickslip_ros.physics.solver.tables import (
    learn_bursts,
    learn_reversals,
    learn_slide,
    learn_swings,
)

#: Numbers that a plant is given by; those behind them follow from them
_INPUTS = (PLANT.names or ()).index("z_slide")
#: Largest tolerance, as a fraction of the limit of z: it sets the accuracy of the friction
_FINEST = 1e-2
#: Bursts faster than this multiple of the ringing after steady sliding are slides.
_FASTEST = 1.25
#: Powers of a length in what is kept of a slide, see `layout.SLIDE_SIZE`
_POWERS = np.array([1, 1, 2, 3, 3, 4, 5, 5, 4])


def pack_plant(plant: Plant, tolerance: float) -> Array:
    """Return the buffer of a plant; tolerance is the error in position (m) allowed per cycle."""
    buffer = np.zeros(PLANT_SIZE)
    record = open_record(buffer, PLANT)
    for name, number in _inputs(plant, tolerance):
        record[name] = number
    derive_constants(buffer)
    return buffer


def pack_plants(
    plants: Plant, tolerance: Array | float, count: int, points: NDArray[np.int64]
) -> tuple[Array, NDArray[np.int64]]:
    """Return the buffers of a column of count plants at some points, and which each point has.

    Equal plants share a buffer, so that their tables are filled once.
    """
    buffers = np.zeros((len(points), PLANT_SIZE))
    records = buffers.view(plain_dtype(PLANT))[:, 0]
    for name, number in _inputs(plants, tolerance):
        records[name] = np.broadcast_to(number, count)[points]
    known: dict[bytes, int] = {}
    each = (row.tobytes() for row in buffers[:, :_INPUTS])
    which = np.array([known.setdefault(one, len(known)) for one in each], np.int64)
    buffers = buffers[np.unique(which, return_index=True)[1]]
    for buffer in buffers:
        derive_constants(buffer)
    return buffers, which


def _inputs(plant: Plant, tolerance: Array | float) -> list[tuple[str, Any]]:
    """Return what a plant is given by, with the names in its record."""
    loads = ("mass", plant.mass), ("force", plant.force), ("spring", plant.spring)
    contact = zip(Contact._fields, plant.contact, strict=True)
    return [*contact, *loads, ("tolerance", tolerance)]


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
    plant.approach_rate, plant.approach_reach = approach(plant)


def contact_buffer(plant: Plant, *points: int) -> Array | None:
    """Return empty buffers for several contacts, see `layout.contacts_in`; None for one.

    A row each for a number of points, if it is given.
    """
    size = 2 * len(plant.contacts) * CONTACT_SIZE
    return np.zeros((*points, size)) if plant.contacts else None


def contact_records(buffer: Array) -> NDArray[Any]:
    """Return the records of several contacts in their buffer, for Python: fields by ["name"].

    Of the buffers of many points, (points, contacts).
    """
    return buffer[..., : buffer.shape[-1] // 2].view(plain_dtype(CONTACT_RECORD))


def set_contacts(buffer: Array | None, plant: Plant) -> None:
    """Write the constants of contacts into the buffers of a plant, or of a column of plants."""
    if buffer is None:
        return
    records, own = contact_records(buffer), list(zip(OWN_CONSTANTS, plant.own, strict=True))
    for i, contact in enumerate(plant.contacts):
        for name, number in (*zip(Contact._fields, contact, strict=True), *own):
            records[name][..., i] = number


_NEVER_MOVED = np.zeros(KERNEL_SIZE)
for _name, _value in {
    **dict.fromkeys(("backstep", "last_step", "last_friction_work"), math.nan),
    **dict.fromkeys(("low", "near_low"), -math.inf),
    **dict.fromkeys(("high", "near_high"), math.inf),
    "replay": 1,
}.items():
    Fields(_NEVER_MOVED)[_name] = _value


def axes_at_rest(count: int) -> Array:
    """Return the buffers of axes at rest at x = 0, (count, KERNEL_SIZE)."""
    return np.tile(_NEVER_MOVED, (count, 1))


def set_clear_range(
    s: Fields,
    plant: Array,
    contacts: Array | None,
    longest: float,
) -> None:
    """Set the range of positions from which an arc cannot reach a stop.

    An arc moves the runner by the longest segment of the drive (m) plus twice the deflection at
    most; s has the fields of the axis, plant and contacts are buffers.
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
    s = kernel_in(axis).state
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
    s = kernel_in(axis).state
    s.start, s.level, s.count = t, s.now_u, count
    s.shift, s.slip, s.slip_end, s.sign = cycle
    s.tau = s.since = s.friction_work = 0.0
    s.x = s.cycle_x = s.x_min = s.x_max = s.now_x
    s.v = s.cycle_v = s.now_v
    s.z = s.cycle_z = s.z_min = s.z_max = s.now_z
    s.open_tau, s.open_x, s.open_v, s.open_z = 0.0, s.x, s.v, s.z
    s.impulse = 0.0
    s.tracking = s.now_tracking = s.now_segment = 0
    s.done = s.segment = s.steady = 0
    if contacts is not None:
        for c in contacts_in(contacts, False):
            c.z, c.second = c.now_z, c.now_second


@compiled
def precompute(plant: np.record, work: NDArray) -> None:
    """Fill the tables of plant, or mark them as not to be used."""
    plant.precomputed = -1
    if plant.kind == ALWAYS_PLASTIC:
        if plant.omega > 0.0:
            learn_reversals(plant, work, 0)
            learn_reversals(plant, work, 1)
            plant.precomputed = 1
        return
    if plant.kind != ELASTOPLASTIC or plant.v_edge != 0.0 or plant.printed != 0:
        return
    z_ba, z_slide = plant.z_ba, plant.z_slide
    w_top = _FASTEST * math.sqrt(max(z_slide * z_slide - z_ba * z_ba, 0.0)) / plant.inv_omega
    if not w_top > 0.0 or z_slide >= plant.z_ss or plant.omega <= 0.0:
        return
    plant.burst_top = w_top
    if not learn_slide(plant, work):
        return
    sides = 1 if plant.force == 0.0 else 2
    for side in range(sides):
        if not learn_bursts(plant, work, side):
            return
    if sides == 1:
        _copy_table(plant.burst[0], plant.burst[1])
    for side in range(sides):
        learn_swings(plant, side)
    if sides == 1:
        plant.swing_from[1], plant.swing_top[1] = plant.swing_from[0], plant.swing_top[0]
        _copy_table(plant.swing[0], plant.swing[1])
    plant.precomputed = 1


@compiled
def _copy_table(table: NDArray, other: NDArray) -> None:
    """Fill another table with the numbers of one (3, NODES)."""
    # Number by number: for an assignment numba compiles texts of errors for 3 s.
    for row in range(3):
        for k in range(NODES):
            other[row, k] = table[row, k]


@compiled
def vary_contacts(
    nominal_buffer: NDArray,
    buffer: NDArray,
    tolerance: float,
    factor: float,
    nominal_contacts: NDArray | None,
    contacts: NDArray | None,
) -> None:
    """Let a plant and its contacts be nominal ones that give way at distances a factor longer.

    tolerance (m) is that of `pack_plant`.
    """
    nominal, plant = plant_in(nominal_buffer), plant_in(buffer)
    _scale_distances(plant, nominal, factor)
    plant.tolerance = tolerance
    derive_constants(buffer)
    # Tables take longer to fill than the one cycle in which the contact is as it is.
    plant.precomputed, plant.burst_top = -1, 0.0
    if contacts is None:
        _scale_tables(nominal, factor, plant)
    else:
        each, nominal_each = contacts_in(contacts, False), contacts_in(nominal_contacts, False)
        for i in range(len(each)):
            _scale_distances(each[i], nominal_each[i], factor)


@compiled
def _scale_distances(contact: np.record, nominal: np.record, factor: float) -> None:
    """Let a contact give way at distances a factor longer than a nominal one."""
    contact.z_ba, contact.z_ss = factor * nominal.z_ba, factor * nominal.z_ss
    contact.z_k, contact.z_s = factor * nominal.z_k, factor * nominal.z_s


@compiled
def _scale_tables(nominal: np.record, factor: float, plant: np.record) -> None:
    """Fill the tables of a plant from those of one that gives way a factor earlier.

    Without a load the motion knows no other length, so that it is the same but for its size.
    """
    if nominal.kind != ELASTOPLASTIC or nominal.force != 0.0:
        return
    if nominal.precomputed == 0:
        precompute(nominal, np.empty((ROWS, ORDER + 1)))
    if nominal.precomputed != 1:
        return
    plant.precomputed, plant.slide_count = 1, nominal.slide_count
    plant.burst_top = factor * nominal.burst_top
    for k in range(SLIDE_SIZE):
        scale = factor ** _POWERS[k]
        for at in range(nominal.slide_count):
            plant.slide[at, k] = nominal.slide[at, k] * scale
    for side in range(2):
        plant.swing_from[side] = factor * nominal.swing_from[side]
        plant.swing_top[side] = math.sqrt(factor) * nominal.swing_top[side]
        for row in range(3):
            scale = 1.0 if row == 1 else factor  # deflection, time, path
            for k in range(NODES):
                plant.swing[side, row, k] = scale * nominal.swing[side, row, k]
                plant.burst[side, row, k] = scale * nominal.burst[side, row, k]
