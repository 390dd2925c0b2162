# SPDX-License-Identifier: Apache-2.0
"""What a plant's arcs have in common is learnt once, when the first of them comes up."""

from __future__ import annotations

import math

from numpy.typing import NDArray

from stickslip_ros.compiled import compiled
from stickslip_ros.model.friction import Contact
from stickslip_ros.solver import state as st
from stickslip_ros.solver.slide import learn_slide
from stickslip_ros.solver.swing import learn_bursts, learn_swings

#: Bursts faster than this multiple of the ringing after steady sliding are slides.
_FASTEST = 1.25


@compiled
def learn(plant: NDArray, work: NDArray, contact: Contact) -> None:
    """Fill the tables of plant, or mark them as not to be used."""
    z_ba, z_slide = contact[3], plant[st.Z_SLIDE]
    plant[st.KNOWN] = -1.0
    w_top = _FASTEST * math.sqrt(max(z_slide * z_slide - z_ba * z_ba, 0.0)) / plant[st.MEMORY]
    if not w_top > 0.0 or z_slide >= contact[4] or plant[st.OMEGA] <= 0.0:
        return
    plant[st.BURST_TOP] = w_top
    if not learn_slide(plant, work, contact):
        return
    loaded = plant[st.FORCE] != 0.0
    if not learn_bursts(plant, work, contact, 0):
        return
    if loaded and not learn_bursts(plant, work, contact, 1):
        return
    if not loaded:
        _mirror_side(plant)
    learn_swings(plant, contact, 0)
    if loaded:
        learn_swings(plant, contact, 1)
    else:
        _mirror_side(plant)
    plant[st.KNOWN] = 1.0


@compiled
def _mirror_side(plant: NDArray) -> None:
    """Without a load both sides are alike."""
    for k in range(st.SIDE_SIZE):
        plant[st.SIDES + st.SIDE_SIZE + k] = plant[st.SIDES + k]
