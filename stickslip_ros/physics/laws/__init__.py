# SPDX-License-Identifier: Apache-2.0
"""The registry of friction laws.

A new one of ours is a file beside this one and a line in `LAWS`; one of somebody else's comes in by
`register_law`, or by a package that names it in the entry point group
``stickslip_ros.laws``.

A law of the form of `Contact` defines only its constants; the solver has closed forms and series
for it. A law of another form has its own ``rate``, with one state or two, which the solver
integrates by explicit steps. ``rows`` are the constants that only this law has.

This room loads neither numba nor numpy, because the table of parameters needs it.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from stickslip_ros.physics.laws.ceim import CEIM, CEIM_WITHOUT_MU
from stickslip_ros.physics.laws.ceim_ageing import CEIM_AGEING
from stickslip_ros.physics.laws.law import LEFT_TO_LAW, Contact, Law, smaller, value_or
from stickslip_ros.physics.laws.lugre import EPM_CALC, EPM_FIX, LUGRE
from stickslip_ros.physics.parameters import FrictionParameters, register
from stickslip_ros.physics.parameters.extensions import RegistrationError, check_name

_KNOWN: dict[str, Law] = {
    "ceim": CEIM,
    "ceim_without_mu": CEIM_WITHOUT_MU,
    "ceim_ageing": CEIM_AGEING,
    "lugre": LUGRE,
    "epm_fix": EPM_FIX,
    "epm_calc": EPM_CALC,
}

_BUILT_IN = frozenset(_KNOWN)
#: Friction laws by the name that the parameter ``model`` takes.
LAWS: Mapping[str, Law] = _KNOWN
#: What is loaded with the first simulation, and compiled with the laws that it knows then
_KERNEL = "stickslip_ros.physics.model.friction"


def register_law(name: str, law: Law) -> None:
    """Let the parameter ``model`` take a law of your own, in this process.

    Parameters
    ----------
    name : str
        Its name, a small word.
    law : Law
        Constants and contact, as those of this room. One with a ``rate`` or ``rows`` of its own has
        to be registered before the first simulation of the process, which is compiled with it.

    Raises
    ------
    RegistrationError
        For a name that is taken, what is no law, or a law that comes too late.
    """
    check_name(name, "law", name in _BUILT_IN, LAWS)
    if not isinstance(law, Law):
        raise RegistrationError(f"{name} is {law!r}; give a stickslip_ros.Law")
    if name in LAWS and all(map(_is_same, LAWS[name], law)):  # a cell that is run again
        return
    if (law.rate or law.rows or _has_more(name)) and _KERNEL in sys.modules:
        raise RegistrationError(
            f"{name} has a rate or constants of its own, and the solver is compiled without them: "
            "register it before the first simulation, or name it in the entry points "
            "stickslip_ros.laws of a package"
        )
    _KNOWN[name] = law
    _list_constants()


def _is_same(a: Any, b: Any) -> bool:
    """Return whether two parts of a law are equal: functions by code, constants by definition."""
    if isinstance(a, type) and isinstance(b, type):
        return [(f.name, f.default) for f in fields(a)] == [(f.name, f.default) for f in fields(b)]
    return bool(a == b or getattr(a, "__code__", a) == getattr(b, "__code__", b))


def _has_more(name: str) -> bool:
    """Return whether a law that is to be replaced has what the solver is compiled with."""
    return name in LAWS and bool(LAWS[name].rate or LAWS[name].rows)


#: The constants that laws have alone, whole numbers and switches as well: fields of the record
#: that `Law.rate` takes. Texts are for `Law.constants` and `Law.contact` alone.
_OWN: tuple[tuple[type, str], ...] = ()
OWN_CONSTANTS: tuple[str, ...] = ()


def _list_constants() -> None:
    global _OWN, OWN_CONSTANTS
    rows = tuple(dict.fromkeys(law.rows for law in LAWS.values() if law.rows))
    for one in rows:
        register("friction", one)
    _OWN = tuple(
        (one, constant.name)
        for one in rows
        for constant in fields(one)
        if "pattern" not in constant.metadata
    )
    OWN_CONSTANTS = tuple(name for _, name in _OWN)


_list_constants()


def of_others() -> dict[str, Law]:
    """Return the laws that are not ours, by their names."""
    return {name: law for name, law in LAWS.items() if name not in _BUILT_IN}


def own_constants(c: FrictionParameters) -> tuple[Any, ...]:
    """Return the values of OWN_CONSTANTS, nan where one is not set; of columns arrays (points,)."""
    return tuple(value_or(getattr(c.own(rows), name), math.nan) for rows, name in _OWN)


__all__ = [
    "LAWS",
    "LEFT_TO_LAW",
    "OWN_CONSTANTS",
    "Contact",
    "Law",
    "RegistrationError",
    "own_constants",
    "register_law",
    "smaller",
    "value_or",
]
