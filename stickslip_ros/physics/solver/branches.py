# SPDX-License-Identifier: Apache-2.0
"""Which smooth branch of a law holds where an arc with alpha > 0 begins."""

from __future__ import annotations

import math

import numpy as np

from stickslip_ros.base.compiled import compiled
from stickslip_ros.physics.laws.law import (
    ALWAYS_PLASTIC,
    ELASTOPLASTIC,
    ELASTOPLASTIC_CALC,
    FOREIGN,
)
from stickslip_ros.physics.model.friction import alpha_at, z_limit
from stickslip_ros.physics.solver.oscillator import newton
from stickslip_ros.physics.solver.taylor import BAND, Branch, alpha_deficit, limit_and_slope

#: Fraction of the tolerance below which the Stribeck curve counts as flat
_FLAT = 1e-4
#: z counts as on the limit of its deflection within this fraction of z_k
_ON_LIMIT = 4.0 * BAND
#: Relative rounding of z_k
_ROUNDING = 1e-16
#: Rounding of a speed that has come down to the edge of the Stribeck curve
_EDGE = 1.0 + 1e-9
#: z nears that of steady sliding as an exponential within this fraction of the tolerance
_REACHED = 0.03
#: Fraction of z - z_ba within which alpha is linear
_LINEAR = 1e-4


@compiled
def stribeck_edge(plant: np.record) -> float:
    """Return the speed (m/s) above which z_lim is z_k, within a ten-thousandth of the tolerance.

    0 without a Stribeck curve. For a runner that the load keeps sliding, z_lim is z_k to rounding,
    because such a runner keeps every error of the friction.
    """
    flat = _FLAT * plant.tolerance
    if plant.slides != 0:
        flat = min(flat, _ROUNDING * plant.z_k)
    height = abs(plant.z_s - plant.z_k) / flat
    return plant.v_s * math.sqrt(math.log(height)) if height > 1.0 else 0.0


@compiled
def is_flat(plant: np.record, w: float) -> bool:
    """Return whether the Stribeck curve plays no part at a speed w > 0 (m/s)."""
    return w > plant.v_edge * _EDGE or plant.v_edge == 0.0


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
    along = False
    jumps = shifted and calc and not flat and w > 0.0
    if jumps and abs(z - limit) <= _ON_LIMIT * plant.z_k:
        plastic, along = _leave_limit(plant, limit, w, pull)
    return Branch(
        z_ss=z_ss,
        plastic=plastic,
        calc=calc and not flat,
        stribeck=not flat,
        along=along,
        sine_start=-plant.z_ba if shifted else plant.z_ba,
        mass=plant.mass,
        pull=pull,
        spring=plant.spring,
        rate=rate,
    )


@compiled
def _leave_limit(plant: np.record, limit: float, w: float, pull: float) -> tuple[bool, bool]:
    """Return whether alpha is 1, and whether z follows z_lim(w) = limit (m), where it jumps to 1.

    Above the limit alpha is 1 and z stays; below the limit z grows by the rest of alpha to 1. If
    the limit rises at a rate between the two, both sides lead back to it, and z follows it
    (Filippov's sliding mode). If it rises faster, z stays below.
    """
    net = pull - plant.sigma_0 * limit - plant.sigma_2 * w
    _, slope = limit_and_slope(w, plant)
    gained = w * alpha_deficit(limit, plant.z_ba, -plant.z_ba)
    rising = slope * net / plant.mass
    along = 0.0 < rising < gained * (1.0 + plant.sigma_1 * slope / plant.mass)
    return not rising > 0.0, along


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
    alpha, _ = alpha_at(math.pi * (z + plant.z_ba) / width)
    if z == plant.z_ba:
        return alpha * z > limit
    return z == plant.z_ss and alpha * z < limit < z


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
    args = (z_ba, math.pi / (z_ss - z_ba), z_k)
    return _steady_root(args, (left, right), True, 0.5 * (left + right), 0.0)


@compiled
def beyond_steady(z: float, args: tuple[float, float, float]) -> tuple[float, float]:
    """Return alpha z - z_k (m) at z (m), and its derivative."""
    z_ba, scale, z_k = args
    alpha, by_angle = alpha_at(scale * (z - z_ba))
    return alpha * z - z_k, alpha + by_angle * scale * z


_steady_root = newton(beyond_steady)


@compiled
def approach(plant: np.record) -> tuple[float, float]:
    """Return at which rate (1/m) z nears `sliding_deflection` along the path, and how near (m).

    Within that distance dz/dr = 1 - alpha z / z_lim counts as linear, and w as constant meanwhile.
    """
    z_ba, z_ss, z_k, z = plant.z_ba, plant.z_ss, plant.z_k, plant.z_slide
    rate, near = 1.0 / z_k, _REACHED * plant.tolerance
    if plant.kind == ELASTOPLASTIC and z < z_ss:
        scale = math.pi / (z_ss - z_ba)
        rate *= z_k / z + alpha_at(scale * (z - z_ba))[1] * scale * z
        near = min(near, _LINEAR * (z - z_ba))
    return rate, near
