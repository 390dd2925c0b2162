# SPDX-License-Identifier: Apache-2.0
"""The contact that a friction law makes of parameters, and the one form of most friction laws.

Such a law (Eq. 1, 3, 7, 16) is nothing but the constants of this form, a `Contact`:

    F  = sigma_0 z + sigma_1 z' + sigma_2 w                 (Eq. 1)
    z' = w - alpha(z, w) |w| / z_lim(w) z                   (Eq. 3, 7, 16)
    z_lim(w) = z_k + (z_s - z_k) exp(-(w / v_s)^2)          (Eq. 4 divided by the stiffness)

-F acts on the runner. The paper prints +F in Eq. 5 and leaves out |w| in Eq. 16; both would feed
energy into the runner, see docs/paper_errata.md.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from stickslip_ros.base.compiled import compile_beside, compiled
from stickslip_ros.physics.laws import LAWS, Law, of_others, smaller
from stickslip_ros.physics.laws.law import (
    ALWAYS_PLASTIC,
    ELASTOPLASTIC_CALC,
    FOREIGN,
    Contact,
)
from stickslip_ros.physics.parameters import FrictionParameters, ParameterError
from stickslip_ros.physics.parameters.extensions import named_in_errors

for _law_of_others in of_others().values():
    if _law_of_others.rate:
        compile_beside(_law_of_others.rate)

#: Stiffness (N/m) below which a contact is refused; real ones have a million and more.
SOFTEST = 1.0
#: Deflections (m) that a contact may have: atoms measure 1e-10, a runner a few millimetres. A limit
#: of z has to be longer than a breakaway distance, which may tend to 0: the solver follows the path
#: of the runner in steps of about such a limit.
SHORTEST, SHORTEST_LIMIT, LONGEST = 1e-15, 1e-12, 1e-2
#: Stribeck velocity (m/s) that a contact may have; measured ones lie between 1e-5 and 0.1.
FASTEST_STRIBECK = 10.0
#: Least distance of z_ss from z_ba, as a fraction of z_ba: alpha needs room to rise.
_LEAST_RISE = 1e-6


def contact_of(c: FrictionParameters, scale: float = 1.0) -> Contact:
    """Return the contact of the friction law; ParameterError if it makes none.

    scale is the preload that somebody sets over that of c, for a cure.
    """
    contact = contact_columns(c)
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
            f"larger: {_cure_of_rise(c, contact, scale)} or lower z_ba"
        )
    return contact


def _cure_of_rise(c: FrictionParameters, contact: Contact, scale: float) -> str:
    """Return how z_ss gets above z_ba: by a preload, where the law calculates it from that."""
    if contact.kind == ELASTOPLASTIC_CALC:
        enough = c.preload * contact.z_ba / _lowest_z_ss(contact)
        enough = float(f"{1.02 * enough:.3g}")  # as somebody types it
        if is_defined(contact_columns(replace(c, preload=enough))):
            return f"raise preload to {scale * enough:.3g} N"
    return "raise z_ss (or preload, where the law calculates it)"


def contact_columns(c: FrictionParameters) -> Contact:
    """Return the contacts of many operating points: numbers in c may be columns (points,).

    Constants that a column bears on are arrays too. Where the law makes no contact, `is_defined`
    says so; ParameterError only for a law that is not known.
    """
    law = _law(c)
    constants = constants_in_force(c)
    with named_in_errors(f"the law {c.model}", law.contact):
        contact = law.contact(constants, _normal_force(c))
    contact = contact._replace(kind=kind_of(law, contact))
    # Where z_ss is twice z_ba, as the CEIM has it, both forms of alpha are the same.
    same = (contact.kind != ELASTOPLASTIC_CALC) & (contact.z_ss == 2.0 * contact.z_ba)
    return contact._replace(printed=(c.alpha_form == "printed") * (1 - same))


def constants_in_force(c: FrictionParameters) -> FrictionParameters:
    """Return the parameters with what the law takes for `LEFT_TO_LAW`; ParameterError."""
    law = _law(c)
    with named_in_errors(f"the law {c.model}", law.constants):
        return law.constants(c, _normal_force(c))


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
        raise ParameterError(
            f"model is {c.model!r}; known: {', '.join(LAWS)}; one of your own needs register_law "
            f"in this process, or the entry points stickslip_ros.laws of a package"
        ) from None


def _lowest_z_ss(contact: Contact) -> Any:
    # With a speed-dependent limit the smaller of the two bounds is the one that must hold.
    return smaller(contact.z_k, contact.z_s) if contact.kind == ELASTOPLASTIC_CALC else contact.z_ss


# -- the equations, as pure functions of numbers


@compiled
def z_limit(w: float, z_k: float, z_s: float, v_s: float) -> float:
    """Return the deflection (m) that steady plastic sliding at w (m/s) tends to; Eq. 4."""
    if z_s == z_k:
        return z_k
    ratio = w / v_s
    return z_k + (z_s - z_k) * math.exp(-ratio * ratio)


@compiled
def alpha(z: float, w: float, z_ba: float, z_ss: float, printed: int) -> float:
    """Return Dupont's alpha (0 elastic .. 1 plastic) at deflection z (m) and speed w (m/s).

    Zero while the contact unloads (sgn z != sgn w): unloading is elastic (Dupont 2002). The paper
    prints z where Dupont has |z| in the sine; with ``printed`` this is taken literally. Both agree
    for z > 0, and everywhere if z_ss = 2 z_ba, as in the CEIM.
    """
    if z * w <= 0.0 or abs(z) <= z_ba:
        return 0.0
    if abs(z) >= z_ss:
        return 1.0
    return alpha_at(math.pi * (abs(z) - sine_start(z, z_ba, printed)) / (z_ss - z_ba))[0]


@compiled
def alpha_at(angle: float) -> tuple[float, float]:
    """Return Dupont's alpha between its ends, and its derivative by the angle.

    The angle is pi (|z| - z_ba) / (z_ss - z_ba): 0 at z_ba, pi at z_ss.
    """
    return 0.5 - 0.5 * math.cos(angle), 0.5 * math.sin(angle)


@compiled
def sine_start(z: float, z_ba: float, printed: int) -> float:
    """Return the |z| (m) at which the sine of alpha begins on the side of z.

    As printed and for z < 0, 1 + sin(pi (z - (z_ss + z_ba) / 2) / (z_ss - z_ba)) is the sine of |z|
    moved by 2 z_ba.
    """
    return -z_ba if printed != 0 and z < 0.0 else z_ba


@compiled
def alpha_of(z: float, w: float, contact: Contact | np.record) -> float:
    """Return alpha at deflection z (m) and differential velocity w (m/s).

    1 for a law with a rate of its own, see `alpha_of_law`.
    """
    if contact.kind >= ALWAYS_PLASTIC:
        return 1.0
    z_ss = contact.z_ss
    if contact.kind == ELASTOPLASTIC_CALC:
        z_ss = z_limit(w, contact.z_k, contact.z_s, contact.v_s)
    return alpha(z, w, contact.z_ba, z_ss, contact.printed)


# -- laws of another form

#: Laws with a rate of their own that the kernel has room for; `rates_of_law` names each
_MOST_FOREIGN = 8

_FOREIGN = tuple(law for law in dict.fromkeys(LAWS.values()) if law.rate)
if len(_FOREIGN) > _MOST_FOREIGN:
    raise ImportError(
        f"{len(_FOREIGN)} laws have a rate of their own; there is room for {_MOST_FOREIGN}"
    )


def kind_of(law: Law, contact: Contact) -> int:
    """Return the kind by which the compiled functions choose the law's rate."""
    return FOREIGN + _FOREIGN.index(law) if law in _FOREIGN else contact.kind


@compiled
def z_rate(z: float, w: float, contact: Contact | np.record) -> float:
    """Return z' (m/s) at deflection z (m) and differential velocity w (m/s); Eq. 3, 7, 16.

    Of a law of the form of `Contact`; nan of any other, see `rates_of_law`.
    """
    if contact.kind >= FOREIGN:
        return math.nan
    limit = z_limit(w, contact.z_k, contact.z_s, contact.v_s)
    return w - alpha_of(z, w, contact) * abs(w) / limit * z


@compiled
def friction_force(z: float, w: float, contact: Contact | np.record) -> float:
    """Return F (N) of Eq. 1 and 15; the runner feels -F. nan where `z_rate` is."""
    return contact.sigma_0 * z + contact.sigma_1 * z_rate(z, w, contact) + contact.sigma_2 * w


def _no_law(z: float, second: float, w: float, c: Any, alpha: Any) -> tuple[float, float]:
    return math.nan, math.nan


def _compiled_rate(k: int) -> Callable[..., Any]:
    return compiled(_FOREIGN[k].rate or _no_law) if k < len(_FOREIGN) else _UNUSED


_UNUSED = compiled(_no_law)
# A call by number would have to be a closure, which is compiled in every process.
_R0, _R1, _R2, _R3 = (_compiled_rate(k) for k in range(4))
_R4, _R5, _R6, _R7 = (_compiled_rate(k) for k in range(4, _MOST_FOREIGN))


#: Whether a law has two states, by its kind less FOREIGN
_TWO = np.array([k < len(_FOREIGN) and _FOREIGN[k].states == 2 for k in range(_MOST_FOREIGN)])


@compiled
def has_two_states(kind: int) -> bool:
    """Return whether a law with a rate of its own has a second state beside z."""
    return kind >= FOREIGN and _TWO[kind - FOREIGN]


@compiled
def rates_of_law(z: float, second: float, w: float, c: np.record) -> tuple[float, float]:
    """Return z' (m/s) and the rate of the second state of any law, 0 if it has none.

    c is a record with the constants of the contact, and those of the law alone, by name.
    """
    kind = c.kind - FOREIGN
    if kind < 0:
        return z_rate(z, w, c), 0.0
    if kind < 4:
        if kind < 2:
            return _R0(z, second, w, c, alpha) if kind == 0 else _R1(z, second, w, c, alpha)
        return _R2(z, second, w, c, alpha) if kind == 2 else _R3(z, second, w, c, alpha)
    if kind < 6:
        return _R4(z, second, w, c, alpha) if kind == 4 else _R5(z, second, w, c, alpha)
    return _R6(z, second, w, c, alpha) if kind == 6 else _R7(z, second, w, c, alpha)


def alpha_of_law(contact: Contact, record: Any, w: float) -> float:
    """Return alpha of any law at differential velocity w (m/s).

    Of one with a rate of its own, it is what the rate takes; 1 where it takes none. The record
    holds ``now_z``, ``now_second`` and the constants of the law.
    """
    if contact.kind < FOREIGN:
        return float(alpha_of(float(record.now_z), w, contact))
    taken = [1.0]

    def take(z: float, w: float, z_ba: float, z_ss: float, printed: int) -> float:
        taken.append(alpha(z, w, z_ba, z_ss, printed))
        return taken[-1]

    rate = _FOREIGN[contact.kind - FOREIGN].rate or _no_law
    rate(float(record.now_z), float(record.now_second), w, record, take)
    return float(taken[-1])
