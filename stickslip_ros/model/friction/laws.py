# SPDX-License-Identifier: Apache-2.0
"""z' and F of the laws of the form of `Contact`, and the rates of those of another form."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from stickslip_ros.compiled import compiled
from stickslip_ros.laws import LAWS, Law
from stickslip_ros.laws.contact import FOREIGN, Contact
from stickslip_ros.model.friction.contact import alpha, alpha_of, z_limit

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
    """Return F (N) of Eq. 1 and 15; the runner feels -F."""
    return contact.sigma_0 * z + contact.sigma_1 * z_rate(z, w, contact) + contact.sigma_2 * w


def _no_law(z: float, inner: float, w: float, c: Any, alpha: Any) -> tuple[float, float]:
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
    return kind >= FOREIGN and _TWO[kind - FOREIGN]  # type: ignore[no-any-return]


@compiled
def rates_of_law(z: float, inner: float, w: float, c: np.record) -> tuple[float, float]:
    """Return z' (m/s) and the rate of the second state of any law, 0 if it has none.

    c is a record with the constants of the contact, and those of the law alone, by name.
    """
    kind = c.kind - FOREIGN
    if kind < 0:
        return z_rate(z, w, c), 0.0
    if kind < 4:
        if kind < 2:
            return _R0(z, inner, w, c, alpha) if kind == 0 else _R1(z, inner, w, c, alpha)
        return _R2(z, inner, w, c, alpha) if kind == 2 else _R3(z, inner, w, c, alpha)
    if kind < 6:
        return _R4(z, inner, w, c, alpha) if kind == 4 else _R5(z, inner, w, c, alpha)
    return _R6(z, inner, w, c, alpha) if kind == 6 else _R7(z, inner, w, c, alpha)
