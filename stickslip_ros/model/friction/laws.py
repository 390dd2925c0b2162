# SPDX-License-Identifier: Apache-2.0
"""The registry of friction laws, and z' and F of any of them.

A new law is a file beside this one and a line in `LAWS`. One that is of the form of `Contact` needs
nothing else, and the solver's closed forms and series serve it. One of another form brings its own
``rate``; the solver then takes its general way.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from stickslip_ros.compiled import compiled, compiled_anew
from stickslip_ros.model.friction.ceim import CEIM, CEIM_WITHOUT_MU
from stickslip_ros.model.friction.contact import FOREIGN, Contact, alpha_of, z_limit
from stickslip_ros.model.friction.elastoplastic import EPM_CALC, EPM_FIX
from stickslip_ros.model.friction.law import Law
from stickslip_ros.model.friction.lugre import LUGRE

#: Friction laws by the name that the parameter ``model`` takes.
LAWS: Mapping[str, Law] = {
    "ceim": CEIM,
    "ceim_without_mu": CEIM_WITHOUT_MU,
    "lugre": LUGRE,
    "epm_fix": EPM_FIX,
    "epm_calc": EPM_CALC,
}

#: The ``kind`` of the contact of each law with a rate of its own
_KINDS = {law: FOREIGN + k for k, law in enumerate(law for law in LAWS.values() if law.rate)}


def kind_of(law: Law, contact: Contact) -> int:
    """Return the kind by which the compiled functions choose the law's rate."""
    return _KINDS.get(law, contact.kind)


def _rate_of_kind() -> Callable[..., Any]:
    """Return the function that calls the rate of the law whose kind a contact has."""

    def first(kind: int, rate: Callable[..., Any], others: Callable[..., Any]) -> Any:
        def chosen(z: float, w: float, contact: Contact) -> Any:
            if contact.kind == kind:
                return rate(z, w, contact)
            return others(z, w, contact)

        return compiled_anew(chosen)

    def unknown(z: float, w: float, contact: Contact) -> float:
        return math.nan

    chain: Callable[..., Any] = compiled_anew(unknown)
    for law, kind in _KINDS.items():
        assert law.rate is not None
        chain = first(kind, law.rate, chain)
    return chain


_foreign_rate = _rate_of_kind()


@compiled
def z_rate(z: float, w: float, contact: Contact) -> float:
    """Return z' (m/s) at deflection z (m) and differential velocity w (m/s); Eq. 3, 7, 16."""
    if contact.kind >= FOREIGN:
        return _foreign_rate(z, w, contact)  # type: ignore[no-any-return]
    limit = z_limit(w, contact.z_k, contact.z_s, contact.v_s)
    return w - alpha_of(z, w, contact) * abs(w) / limit * z


@compiled
def friction_force(z: float, w: float, contact: Contact) -> float:
    """Return F (N) of Eq. 1 and 15; the runner feels -F."""
    return contact.sigma_0 * z + contact.sigma_1 * z_rate(z, w, contact) + contact.sigma_2 * w
