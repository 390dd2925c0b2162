# SPDX-License-Identifier: Apache-2.0
"""Friction laws. A new one is a file beside these and a line in LAWS."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from stickslip_ros.model.friction.ceim import CEIM, CEIM_WITHOUT_MU
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
from stickslip_ros.model.friction.elastoplastic import EPM_CALC, EPM_FIX
from stickslip_ros.model.friction.law import Constants, Law, smaller, value_or
from stickslip_ros.model.friction.lugre import LUGRE
from stickslip_ros.parameters import FrictionParameters, ParameterError

#: Stiffness (N/m) below which a contact is refused; real ones have a million and more.
SOFTEST = 1.0

#: Friction laws by the name that the parameter ``model`` takes.
LAWS: Mapping[str, Law] = {
    "ceim": CEIM,
    "ceim_without_mu": CEIM_WITHOUT_MU,
    "lugre": LUGRE,
    "epm_fix": EPM_FIX,
    "epm_calc": EPM_CALC,
}

__all__ = [
    "ALWAYS_PLASTIC",
    "ELASTOPLASTIC",
    "ELASTOPLASTIC_CALC",
    "LAWS",
    "Contact",
    "Law",
    "alpha_of",
    "constants_in_force",
    "contact_of",
    "contacts_of",
    "friction_force",
    "is_defined",
    "value_or",
    "z_limit",
    "z_rate",
]


def contact_of(c: FrictionParameters) -> Contact:
    """Return the contact of the friction law; ParameterError if it makes none."""
    contact = contacts_of(c)
    if not contact.sigma_0 >= SOFTEST:
        raise ParameterError(
            f"the stiffness of the contact is {contact.sigma_0:g} N/m, {SOFTEST:g} N/m is the "
            "lower limit: raise sigma_0, or sigma_0_slope and sigma_0_offset"
        )
    if not is_defined(contact):
        raise ParameterError(
            f"z_ss is {_lowest_z_ss(contact):g} m and z_ba {contact.z_ba:g} m; z_ss has to be "
            "larger: raise z_ss (or preload, where the law calculates it) or lower z_ba"
        )
    return contact


def contacts_of(c: FrictionParameters) -> Contact:
    """Return the contacts of many operating points: numbers in c may be columns (points,).

    Constants that a column bears on are arrays too. Where the law makes no contact, `is_defined`
    says so; ParameterError only for a law that is not known.
    """
    contact = _law(c).contact(c, _normal_force(c))
    # Where z_ss is twice z_ba, as the CEIM has it, both forms of alpha are the same.
    same = (contact.kind != ELASTOPLASTIC_CALC) & (contact.z_ss == 2.0 * contact.z_ba)
    return contact._replace(printed=(c.alpha_form == "printed") * (1 - same))


def constants_in_force(c: FrictionParameters) -> Constants:
    """Return the constants that the law uses where it has values of its own; ParameterError."""
    return _law(c).constants(c, _normal_force(c))


def is_defined(contact: Contact) -> Any:
    """Return whether it is stiff and alpha has room between z_ba and z_ss; of arrays, where."""
    room = contact.kind == ALWAYS_PLASTIC or _lowest_z_ss(contact) > contact.z_ba
    return (contact.sigma_0 >= SOFTEST) & room


def _normal_force(c: FrictionParameters) -> Any:
    """Return the normal force (N) that the law is loaded with.

    Section 5.2 means by preload the sum of the normal forces of all contacts, then puts in what a
    load cell reads; a guide makes the sum ``preload_ratio`` times that (Appendix, Table 5).
    """
    return c.preload_ratio * c.preload


def _law(c: FrictionParameters) -> Law:
    try:
        return LAWS[c.model]
    except KeyError:
        raise ParameterError(f"model is {c.model!r}; known: {', '.join(LAWS)}") from None


def _lowest_z_ss(contact: Contact) -> Any:
    # With a speed-dependent limit the smaller of the two bounds is the one that must hold.
    return smaller(contact.z_k, contact.z_s) if contact.kind == ELASTOPLASTIC_CALC else contact.z_ss
