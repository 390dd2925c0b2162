# SPDX-License-Identifier: Apache-2.0
"""LuGre friction with Stribeck and viscous terms (Eq. 1-4), and the laws built on it (Eq. 7, 8)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from stickslip_ros.physics.laws.law import (
    ALWAYS_PLASTIC,
    ELASTOPLASTIC,
    ELASTOPLASTIC_CALC,
    Contact,
    Law,
    value_or,
)
from stickslip_ros.physics.parameters import FrictionParameters

#: N/m, Table 2
SIGMA_0 = 1e6


def _constants(c: FrictionParameters, _: Any) -> FrictionParameters:
    return replace(c, sigma_0=value_or(c.sigma_0, SIGMA_0), sigma_0ss=None, z_ba=None, z_ss=None)


def _contact(c: Any, f: Any) -> Contact:
    """Return the contact of Eq. 1-4, with the normal force f (N): always plastic (alpha = 1)."""
    return Contact(
        sigma_0=c.sigma_0,
        sigma_1=c.sigma_1,
        sigma_2=c.sigma_2,
        z_ba=0.0,
        z_ss=0.0,
        z_k=c.mu_k * f / c.sigma_0,
        z_s=c.mu_s * f / c.sigma_0,
        v_s=c.v_stribeck,
        kind=ALWAYS_PLASTIC,
    )


LUGRE = Law(_constants, _contact, free=("sigma_0", "sigma_1", "mu_k"))


#: Breakaway and steady-state deflection of Table 2, m
Z_BA_FIX, Z_SS_FIX, Z_BA_CALC = 50e-9, 100e-9, 100e-9


def _constants_calc(c: FrictionParameters, f: Any) -> FrictionParameters:
    return replace(LUGRE.constants(c, f), z_ba=value_or(c.z_ba, Z_BA_CALC))


def _calc(c: Any, f: Any) -> Contact:
    """Return the contact of Eq. 7 with z_ss = g(w) / sigma_0 (Eq. 8).

    Defined only where z_ss at speed, mu_k f / sigma_0, is above z_ba: from 0.5 N on with Table 2.
    """
    return LUGRE.contact(c, f)._replace(z_ba=c.z_ba, kind=ELASTOPLASTIC_CALC)


def _constants_fix(c: FrictionParameters, f: Any) -> FrictionParameters:
    z_ba, z_ss = value_or(c.z_ba, Z_BA_FIX), value_or(c.z_ss, Z_SS_FIX)
    return replace(LUGRE.constants(c, f), z_ba=z_ba, z_ss=z_ss)


def _fix(c: Any, f: Any) -> Contact:
    """Return the contact of Eq. 7 with fixed z_ba and z_ss in alpha; g(w) / sigma_0 limits z."""
    return LUGRE.contact(c, f)._replace(z_ba=c.z_ba, z_ss=c.z_ss, kind=ELASTOPLASTIC)


EPM_CALC = Law(_constants_calc, _calc, free=("sigma_0", "sigma_1", "z_ba", "mu_k"))
EPM_FIX = Law(_constants_fix, _fix, free=("sigma_0", "sigma_1", "z_ba", "z_ss", "mu_k"))
