# SPDX-License-Identifier: Apache-2.0
"""Tables of arcs, computed once for a plant, when the first such arc begins."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.compiled import compiled
from stickslip_ros.model.friction import ALWAYS_PLASTIC, ELASTOPLASTIC
from stickslip_ros.solver.layout import NODES, ORDER, ROWS, SLIDE_SIZE, contacts_in, plant_in
from stickslip_ros.solver.plants import derive_constants
from stickslip_ros.solver.slides import learn_slide
from stickslip_ros.solver.swings import learn_bursts, learn_reversals, learn_swings

#: Bursts faster than this multiple of the ringing after steady sliding are slides.
_FASTEST = 1.25
#: Powers of a length in what is kept of a slide, see `layout.SLIDE_SIZE`
_POWERS = np.array([1, 1, 2, 3, 3, 4, 5, 5, 4])


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
        plant.burst[1] = plant.burst[0]
    for side in range(sides):
        learn_swings(plant, side)
    if sides == 1:
        plant.swing_from[1], plant.swing_top[1] = plant.swing_from[0], plant.swing_top[0]
        plant.swing[1] = plant.swing[0]
    plant.precomputed = 1


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

    tolerance (m) is that of `plants.pack_plant`.
    """
    nominal, plant = plant_in(nominal_buffer), plant_in(buffer)
    _scale_distances(plant, nominal, factor)
    plant.tolerance = tolerance
    derive_constants(buffer)
    # Tables take longer to fill than the one cycle in which the contact is as it is.
    plant.precomputed, plant.burst_top = -1, 0.0
    if contacts is None:
        _take_tables(nominal, factor, plant)
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
def _take_tables(nominal: np.record, factor: float, plant: np.record) -> None:
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
