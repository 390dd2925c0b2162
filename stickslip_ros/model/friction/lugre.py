# SPDX-License-Identifier: Apache-2.0
"""LuGre friction with Stribeck and viscous terms (Eq. 1-4)."""

from __future__ import annotations

from stickslip_ros.model.friction.choice import chosen
from stickslip_ros.model.friction.contact import ALWAYS_PLASTIC, Contact
from stickslip_ros.parameters import Values

#: N/m, Table 2
SIGMA_0 = 1e6


def lugre(p: Values) -> Contact:
    """Return the contact of Eq. 1-4: plastic at every deflection (alpha = 1)."""
    sigma_0 = chosen(p["sigma_0"], SIGMA_0)
    return Contact(
        sigma_0=sigma_0,
        sigma_1=p["sigma_1"],
        sigma_2=p["sigma_2"],
        z_ba=0.0,
        z_ss=0.0,
        z_k=p["mu_k"] * p["preload"] / sigma_0,
        z_s=p["mu_s"] * p["preload"] / sigma_0,
        v_s=p["v_stribeck"],
        kind=ALWAYS_PLASTIC,
    )
