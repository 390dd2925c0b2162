# SPDX-License-Identifier: Apache-2.0
"""Which smooth branch of a law holds where an arc with alpha > 0 begins."""

from __future__ import annotations

import math

import numpy as np

from stickslip_ros.compiled import compiled
from stickslip_ros.model.friction import (
    ALWAYS_PLASTIC,
    ELASTOPLASTIC,
    ELASTOPLASTIC_CALC,
    FOREIGN,
    Contact,
    z_limit,
)
from stickslip_ros.solver.taylor import BAND, Branch

#: Share of the tolerance below which what is left of the Stribeck curve counts as nothing
_FLAT = 1e-4
#: Rounding of a speed that has come down to the edge of the Stribeck curve
_EDGE = 1.0 + 1e-9
#: Share of the tolerance by which z may be off steady sliding where it nears it as an exponential;
#: share of z - z_ba over which alpha is linear
_SETTLED, _LINEAR = 0.03, 1e-4


@compiled
def contact_of_plant(plant: np.record) -> Contact:
    """Return the contact of a prepared plant."""
    return Contact(
        plant.sigma_0,
        plant.sigma_1,
        plant.sigma_2,
        plant.z_ba,
        plant.z_ss,
        plant.z_k,
        plant.z_s,
        plant.v_s,
        plant.kind,
        plant.printed,
    )


@compiled
def stribeck_edge(plant: np.record) -> float:
    """Return the speed (m/s) above which z_lim is z_k, but for a ten-thousandth of the tolerance.

    0 where the curve has no height.
    """
    height = abs(plant.z_s - plant.z_k) / (_FLAT * plant.tolerance)
    return plant.v_s * math.sqrt(math.log(height)) if height > 1.0 else 0.0


@compiled
def is_flat(plant: np.record, w: float) -> bool:
    """Return whether the Stribeck curve plays no part at a speed w > 0 (m/s)."""
    return plant.kind < FOREIGN and (w > plant.v_edge * _EDGE or plant.v_edge == 0.0)


@compiled
def branch_at(
    plant: np.record, z: float, w: float, pull: float, rate: float, mirror: float
) -> Branch:
    """Return the branch that holds at z, w >= 0 (mirrored), pull (N) and u' = rate (m/s)."""
    flat = is_flat(plant, w)
    calc = plant.kind == ELASTOPLASTIC_CALC
    z_ss = plant.z_k if calc and flat else plant.z_ss
    limit = plant.z_k if flat else z_limit(w, plant.z_k, plant.z_s, plant.v_s)
    if plant.kind >= ALWAYS_PLASTIC:
        plastic = True
    elif calc and not flat:
        plastic = z >= limit - BAND * plant.z_k
    else:
        plastic = z > z_ss or (z == z_ss and limit >= z_ss)
    shifted = plant.printed != 0 and mirror < 0.0
    return Branch(
        plant.sigma_0,
        plant.sigma_1,
        plant.sigma_2,
        plant.z_ba,
        z_ss,
        plant.z_k,
        plant.z_s,
        plant.v_s,
        plastic,
        calc and not flat,
        not flat,
        -plant.z_ba if shifted else plant.z_ba,
        plant.kind if plant.kind >= FOREIGN else 0,
        plant.mass,
        pull,
        plant.spring,
        rate,
    )


@compiled
def held_at_jump(plant: np.record, z: float, w: float, mirror: float) -> bool:
    """Return whether alpha as printed holds z (m, mirrored) at w >= 0 (m/s) where it jumps.

    It jumps at z_ba and at z_ss, for z < 0 alone. Where alpha z is too small to stop z below the
    jump and too large above it, z stays there.
    """
    if plant.printed == 0 or mirror > 0.0 or plant.kind != ELASTOPLASTIC:
        return False
    limit = z_limit(w, plant.z_k, plant.z_s, plant.v_s)
    width = plant.z_ss - plant.z_ba
    if z == plant.z_ba:
        above = 0.5 - 0.5 * math.cos(math.pi * (z + plant.z_ba) / width)
        return above * z > limit  # type: ignore[no-any-return]
    below = 0.5 - 0.5 * math.cos(math.pi * (z + plant.z_ba) / width)
    return z == plant.z_ss and below * z < limit < z  # type: ignore[no-any-return]


@compiled
def path_branch(plant: np.record) -> Branch:
    """Return the branch from z_ba on whose time is the path: an infinite mass keeps w at 1 m/s."""
    return Branch(
        plant.sigma_0,
        plant.sigma_1,
        plant.sigma_2,
        plant.z_ba,
        plant.z_ss,
        plant.z_k,
        plant.z_s,
        plant.v_s,
        False,
        False,
        False,
        plant.z_ba,
        0,
        math.inf,
        0.0,
        0.0,
        0.0,
    )


@compiled
def sliding_deflection(plant: np.record) -> float:
    """Return |z| (m) of steady sliding above the Stribeck curve, where alpha z = z_lim.

    nan if it depends on the side, as with alpha as printed.
    """
    z_ba, z_ss, z_k = plant.z_ba, plant.z_ss, plant.z_k
    if plant.printed != 0 or plant.kind >= FOREIGN:
        return math.nan
    if plant.kind != 0 or z_k >= z_ss:
        return z_k
    left, right = max(z_ba, z_k), z_ss
    scale = math.pi / (z_ss - z_ba)
    z = 0.5 * (left + right)
    for _ in range(100):
        angle = scale * (z - z_ba)
        share = 0.5 * (1.0 - math.cos(angle))
        excess = share * z - z_k
        if excess > 0.0:
            right = z
        else:
            left = z
        step = excess / (share + 0.5 * scale * math.sin(angle) * z)
        if not left < z - step < right:
            step = z - 0.5 * (left + right)
        if z - step == z:
            break
        z -= step
    return z


@compiled
def settling(plant: np.record) -> tuple[float, float]:
    """Return at which rate (1/m) z nears `sliding_deflection` along the path, and how near (m).

    Within that distance dz/dr = 1 - alpha z / z_lim counts as linear, and w as constant meanwhile.
    """
    z_ba, z_ss, z_k, z = plant.z_ba, plant.z_ss, plant.z_k, plant.z_slide
    rate, near = 1.0 / z_k, _SETTLED * plant.tolerance
    if plant.kind == ELASTOPLASTIC and z < z_ss:
        scale = math.pi / (z_ss - z_ba)
        rate *= z_k / z + 0.5 * scale * math.sin(scale * (z - z_ba)) * z
        near = min(near, _LINEAR * (z - z_ba))
    return rate, near
