# SPDX-License-Identifier: Apache-2.0
"""CEIM friction: breakaway and stiffness follow the preload (Eq. 12-16)."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

from stickslip_ros.physics.laws.law import ELASTOPLASTIC, Contact, Law, smaller, value_or
from stickslip_ros.physics.parameters import FrictionParameters

#: sigma_0,ss in N/m. The paper gives none; with this one the drive of Table 1 steps 134 nm
#: (paper: 130 nm) and the preload curve falls to zero near 5 N (paper: about 5 N).
SIGMA_0SS = 1e7
#: The same with mu folded into it (section 5.6), for mu = 0.2.
SIGMA_0SS_WITHOUT_MU = 5e7


def _constants(c: FrictionParameters, f: Any, sigma_0ss: float = SIGMA_0SS) -> FrictionParameters:
    """Return the constants in force at the normal force f (N); sigma_0ss (N/m) is the law's own."""
    z_ba = value_or(c.z_ba, c.z_ba_slope * f + c.z_ba_offset)  # Eq. 13
    # Eq. 14, constant above the normal force sigma_0_cap if set
    stiffness = c.sigma_0_slope * smaller(f, value_or(c.sigma_0_cap, f)) + c.sigma_0_offset
    return replace(
        c,
        sigma_0=value_or(c.sigma_0, stiffness),
        sigma_0ss=value_or(c.sigma_0ss, sigma_0ss),
        z_ba=z_ba,
        z_ss=value_or(c.z_ss, 2.0 * z_ba),  # Eq. 12
    )


def _contact(c: Any, f: Any) -> Contact:
    """Return the contact of Eq. 12-16, from the normal force f (N)."""
    return _ceim(c, f / (c.sigma_0ss / c.mu))


def _contact_without_mu(c: Any, f: Any) -> Contact:
    """Return the contact of section 5.6: mu folded into sigma_0,ss (N/m)."""
    return _ceim(c, f / c.sigma_0ss)


def _ceim(c: Any, z_lim: Any) -> Contact:
    """Return the contact with the limit of the deflection z_lim (m), Eq. 16."""
    return Contact(
        sigma_0=c.sigma_0,
        sigma_1=c.sigma_1,
        sigma_2=c.sigma_2,
        z_ba=c.z_ba,
        z_ss=c.z_ss,
        z_k=z_lim,
        z_s=z_lim,
        v_s=c.v_stribeck,
        kind=ELASTOPLASTIC,
    )


CEIM = Law(
    _constants,
    _contact,
    free=("sigma_0", "sigma_1", "z_ba", "sigma_0ss"),
    several_free=(
        "sigma_0_slope", "sigma_0_offset", "sigma_1", "z_ba_slope", "z_ba_offset", "sigma_0ss",
    ),
)  # fmt: skip
CEIM_WITHOUT_MU = CEIM._replace(
    constants=partial(_constants, sigma_0ss=SIGMA_0SS_WITHOUT_MU), contact=_contact_without_mu
)
