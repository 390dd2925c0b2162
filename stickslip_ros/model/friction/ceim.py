# SPDX-License-Identifier: Apache-2.0
"""CEIM friction: breakaway and stiffness follow the preload (Eq. 12-16)."""

from __future__ import annotations

from stickslip_ros.model.friction.choice import chosen, smaller
from stickslip_ros.model.friction.contact import ELASTOPLASTIC, Contact
from stickslip_ros.parameters import Values

#: sigma_0,ss in N/m. The paper gives none; with this one the drive of Table 1 steps 134 nm
#: (paper: 130 nm) and the preload curve falls to zero near 5 N (paper: about 5 N).
SIGMA_0SS = 1e7
#: Of the plain CEIM; the law without mu folds it into sigma_0,ss (section 5.6).
MU = 0.2


def ceim(p: Values) -> Contact:
    """Return the contact of Eq. 12-16, from preload f (N) and the constants a, b, o, p, mu."""
    return _ceim(p, chosen(p["sigma_0ss"], SIGMA_0SS) / p["mu"])


def ceim_without_mu(p: Values) -> Contact:
    """Return the contact of section 5.6: mu folded into sigma_0,ss (N/m)."""
    return _ceim(p, chosen(p["sigma_0ss"], SIGMA_0SS / MU))


def _ceim(p: Values, stiffness_per_mu: float) -> Contact:
    f = p["preload"]
    z_ba = chosen(p["z_ba"], p["z_ba_slope"] * f + p["z_ba_offset"])  # Eq. 13
    z_lim = f / stiffness_per_mu  # Eq. 16
    return Contact(
        sigma_0=chosen(p["sigma_0"], sigma_0_star(p)),
        sigma_1=p["sigma_1"],
        sigma_2=p["sigma_2"],
        z_ba=z_ba,
        z_ss=chosen(p["z_ss"], 2.0 * z_ba),  # Eq. 12
        z_k=z_lim,
        z_s=z_lim,
        v_s=p["v_stribeck"],
        kind=ELASTOPLASTIC,
    )


def sigma_0_star(p: Values) -> float:
    """Return sigma_0* (N/m) of Eq. 14, constant above the preload ``sigma_0_cap`` if set."""
    f = smaller(p["preload"], chosen(p["sigma_0_cap"], p["preload"]))
    return p["sigma_0_slope"] * f + p["sigma_0_offset"]  # type: ignore[no-any-return]
