# SPDX-License-Identifier: Apache-2.0
"""The contact that a friction law makes of parameters, and checks of impossible contacts."""

from __future__ import annotations

from typing import Any

from stickslip_ros.laws import LAWS, Law, smaller, value_or
from stickslip_ros.laws.contact import (
    ALWAYS_PLASTIC,
    DISTANCES,
    ELASTOPLASTIC,
    ELASTOPLASTIC_CALC,
    FOREIGN,
    Contact,
)
from stickslip_ros.model.friction.laws import (
    alpha_at,
    alpha_of,
    friction_force,
    has_two_states,
    kind_of,
    rates_of_law,
    z_limit,
    z_rate,
)
from stickslip_ros.parameters import FrictionParameters, ParameterError

#: Stiffness (N/m) below which a contact is refused; real ones have a million and more.
SOFTEST = 1.0
#: Deflections (m) that a contact may have: atoms measure 1e-10, a runner a few millimetres. A limit
#: of z has to be longer than a breakaway distance, which may tend to 0: the solver follows the path
#: of the runner in steps of about such a limit.
SHORTEST, SHORTEST_LIMIT, LONGEST = 1e-15, 1e-12, 1e-2
#: Stribeck velocity (m/s) that a contact may have; measured ones lie between 1e-5 and 0.1.
FASTEST_STRIBECK = 10.0
#: Least distance of z_ss from z_ba, as a share of z_ba: alpha needs room to rise.
_LEAST_RISE = 1e-6

__all__ = [
    "ALWAYS_PLASTIC",
    "DISTANCES",
    "ELASTOPLASTIC",
    "ELASTOPLASTIC_CALC",
    "FOREIGN",
    "LAWS",
    "Contact",
    "Law",
    "alpha_at",
    "alpha_of",
    "constants_in_force",
    "contact_of",
    "contacts_of",
    "friction_force",
    "has_own_rate",
    "has_two_states",
    "is_defined",
    "rates_of_law",
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
    for name, cure in _DEFLECTIONS.items():
        value = getattr(contact, name)
        if not _is_a_deflection(contact, name):
            raise ParameterError(
                f"{name} of the contact is {value:g} m; it has to lie between {_least(name):g} m, "
                f"far below an atom, and {LONGEST:g} m: {cure}"
            )
    if not _has_a_stribeck_velocity(contact):
        raise ParameterError(
            f"v_stribeck is {contact.v_s:g} m/s, {FASTEST_STRIBECK:g} m/s is the upper limit, a "
            "hundred times what is measured: lower it, or make mu_s equal to mu_k"
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
    law = _law(c)
    contact = law.contact(constants_in_force(c), _normal_force(c))
    contact = contact._replace(kind=kind_of(law, contact))
    # Where z_ss is twice z_ba, as the CEIM has it, both forms of alpha are the same.
    same = (contact.kind != ELASTOPLASTIC_CALC) & (contact.z_ss == 2.0 * contact.z_ba)
    return contact._replace(printed=(c.alpha_form == "printed") * (1 - same))


def constants_in_force(c: FrictionParameters) -> FrictionParameters:
    """Return the parameters with what the law takes for `LEFT_TO_LAW`; ParameterError."""
    return _law(c).constants(c, _normal_force(c))


#: Where a deflection of the contact comes from
_DEFLECTIONS = {
    "z_k": "change sigma_0ss, or mu, mu_k, preload and sigma_0",
    "z_s": "change sigma_0ss, or mu, mu_s, preload and sigma_0",
    "z_ba": "change z_ba, or z_ba_slope and z_ba_offset",
}


def _is_a_deflection(contact: Contact, name: str) -> Any:
    """Return whether a deflection of the contact can be one; of arrays, where."""
    value = getattr(contact, name)
    none_needed = name == "z_ba" and contact.kind >= ALWAYS_PLASTIC
    return none_needed | ((value >= _least(name)) & (value <= LONGEST))


def _least(name: str) -> float:
    """Return the shortest (m) that a deflection of the contact may be."""
    return SHORTEST if name == "z_ba" else SHORTEST_LIMIT


def _has_a_stribeck_velocity(contact: Contact) -> Any:
    """Return whether the Stribeck curve, if there is one, lies at speeds of a contact."""
    return (contact.v_s <= FASTEST_STRIBECK) | (contact.z_s == contact.z_k)


def is_defined(contact: Contact) -> Any:
    """Return whether a contact can be one and alpha has room; of arrays, where."""
    defined = (contact.sigma_0 >= SOFTEST) & _has_a_stribeck_velocity(contact)
    for name in _DEFLECTIONS:
        defined = defined & _is_a_deflection(contact, name)
    room = _lowest_z_ss(contact) > contact.z_ba * (1.0 + _LEAST_RISE)
    # A law without breakaway has none of both; one with a rate of its own may have them.
    return defined & (((contact.kind >= ALWAYS_PLASTIC) & (contact.z_ss == 0.0)) | room)


def has_own_rate(c: FrictionParameters) -> bool:
    """Return whether the friction law has a rate of its own; ParameterError."""
    return _law(c).rate is not None


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
