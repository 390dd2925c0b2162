# SPDX-License-Identifier: Apache-2.0
"""Elastoplastic friction with calculated and with fixed z_ss (Eq. 7, 8)."""

from __future__ import annotations

from stickslip_ros.model.friction.choice import chosen
from stickslip_ros.model.friction.contact import ELASTOPLASTIC, ELASTOPLASTIC_CALC, Contact
from stickslip_ros.model.friction.lugre import lugre
from stickslip_ros.parameters import Values

#: m, Table 2
Z_BA_FIX, Z_SS_FIX, Z_BA_CALC = 50e-9, 100e-9, 100e-9


def elastoplastic_calc(p: Values) -> Contact:
    """Return the contact of Eq. 7 with z_ss = g(w) / sigma_0 (Eq. 8).

    Defined only where z_ss at speed, mu_k f / sigma_0, is above z_ba: from 0.5 N on with Table 2.
    """
    return lugre(p)._replace(z_ba=chosen(p["z_ba"], Z_BA_CALC), kind=ELASTOPLASTIC_CALC)


def elastoplastic_fix(p: Values) -> Contact:
    """Return the contact of Eq. 7 with fixed z_ba and z_ss in alpha; g(w) / sigma_0 limits z."""
    return lugre(p)._replace(
        z_ba=chosen(p["z_ba"], Z_BA_FIX), z_ss=chosen(p["z_ss"], Z_SS_FIX), kind=ELASTOPLASTIC
    )
