# SPDX-License-Identifier: Apache-2.0
"""What the report holds, in the order of the paper: a line for each item."""

from __future__ import annotations

from stickslip_ros.paper import (
    elongation,
    fig02_response,
    fig03_amplitude,
    fig04_ratio,
    fig05_preload,
    fig07_slewrate,
    fig10_stiffness,
    fig13_velocity,
    fig15_force,
    materials,
    sec22_influences,
    sec45_hysteresis,
    shaping,
    tab01_typical,
    tab05_guide,
)
from stickslip_ros.paper.item import Item

ITEMS: tuple[Item, ...] = (
    fig02_response.ITEM,
    sec45_hysteresis.SHAPE,
    tab01_typical.TABLE_1,
    fig03_amplitude.ITEM,
    sec22_influences.INFLUENCES,
    fig04_ratio.RATIO,
    fig04_ratio.NEGATIVE,
    fig05_preload.FIGURE_5,
    fig05_preload.TABLE_2,
    materials.TABLE_3,
    materials.FIGURE_6,
    fig07_slewrate.ITEM,
    sec22_influences.BALANCE,
    shaping.ITEM,
    elongation.ITEM,
    materials.FIGURE_8,
    materials.FIGURE_9,
    fig10_stiffness.ITEM,
    sec45_hysteresis.EFFECT,
    tab01_typical.FIGURE_11,
    materials.FIGURE_12,
    fig13_velocity.ITEM,
    fig05_preload.FIGURE_14,
    fig15_force.ITEM,
    tab05_guide.ITEM,
)
