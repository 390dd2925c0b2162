# SPDX-License-Identifier: Apache-2.0
"""LuGre friction with Stribeck and viscous terms (Eq. 1-4)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from stickslip_ros.laws.contact import ALWAYS_PLASTIC, Contact
from stickslip_ros.laws.law import Law, value_or
from stickslip_ros.parameters import FrictionParameters

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
