# SPDX-License-Identifier: Apache-2.0
"""Friction laws. A new one is a file beside these and a line in LAWS."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from stickslip_ros.model.friction.ceim import ceim, ceim_without_mu
from stickslip_ros.model.friction.choice import smaller
from stickslip_ros.model.friction.contact import (
    ALWAYS_PLASTIC,
    ELASTOPLASTIC,
    ELASTOPLASTIC_CALC,
    Contact,
    alpha_of,
    friction_force,
    z_limit,
    z_rate,
)
from stickslip_ros.model.friction.elastoplastic import elastoplastic_calc, elastoplastic_fix
from stickslip_ros.model.friction.lugre import lugre
from stickslip_ros.parameters import ParameterError, Values

#: Stiffness (N/m) below which a contact is refused; real ones have a million and more.
SOFTEST = 1.0

LAWS: Mapping[str, Callable[[Values], Contact]] = {
    "ceim": ceim,
    "ceim_without_mu": ceim_without_mu,
    "lugre": lugre,
    "epm_fix": elastoplastic_fix,
    "epm_calc": elastoplastic_calc,
}

__all__ = [
    "ALWAYS_PLASTIC",
    "ELASTOPLASTIC",
    "ELASTOPLASTIC_CALC",
    "LAWS",
    "Contact",
    "alpha_of",
    "contact_of",
    "contacts_of",
    "friction_force",
    "is_defined",
    "z_limit",
    "z_rate",
]


def contact_of(p: Values) -> Contact:
    """Return the contact of the law that ``p["model"]`` names; ParameterError if it makes none."""
    contact = _made(p)
    if not contact.sigma_0 >= SOFTEST:
        raise ParameterError(
            f"the stiffness of the contact is {contact.sigma_0:g} N/m, {SOFTEST:g} N/m is the "
            "least: raise sigma_0, or sigma_0_slope and sigma_0_offset"
        )
    if not is_defined(contact):
        raise ParameterError(
            f"z_ss is {_lowest_z_ss(contact):g} m and z_ba {contact.z_ba:g} m; z_ss has to be "
            "larger: raise z_ss (or preload, where the law calculates it) or lower z_ba"
        )
    return contact


def contacts_of(p: Values) -> Contact:
    """Return the contacts of many operating points: numbers in p may be arrays of equal shape.

    Constants that an array bears on are arrays too. Where the law makes no contact, `is_defined`
    says so; ParameterError only for a law that is not known.
    """
    return _made(p)


def _made(p: Values) -> Contact:
    """Return the contact of the law, with the form of alpha that is asked for.

    Where z_ss is twice z_ba, as the CEIM has it, both forms are the same.
    """
    contact = _law_of(p)(_loaded(p))
    same = (contact.kind != ELASTOPLASTIC_CALC) & (contact.z_ss == 2.0 * contact.z_ba)
    return contact._replace(printed=(p["alpha_form"] == "printed") * (1 - same))


def is_defined(contact: Contact) -> Any:
    """Return whether it is stiff and alpha has room between z_ba and z_ss; of arrays, where."""
    room = contact.kind == ALWAYS_PLASTIC or _lowest_z_ss(contact) > contact.z_ba
    return (contact.sigma_0 >= SOFTEST) & room


def _loaded(p: Values) -> Values:
    """Return p with the normal force that the law takes in place of the preload.

    Section 5.2 means by preload the sum of the normal forces of all contacts, then puts in what a
    load cell reads; a guide makes the sum ``preload_ratio`` times that (Appendix, Table 5).
    """
    return {**p, "preload": p["preload_ratio"] * p["preload"]}


def _law_of(p: Values) -> Callable[[Values], Contact]:
    try:
        return LAWS[p["model"]]
    except KeyError:
        raise ParameterError(f"model is {p['model']!r}; known: {', '.join(LAWS)}") from None


def _lowest_z_ss(contact: Contact) -> Any:
    # With a speed-dependent limit the smaller of the two bounds is the one that must hold.
    return smaller(contact.z_k, contact.z_s) if contact.kind == ELASTOPLASTIC_CALC else contact.z_ss
