# SPDX-License-Identifier: Apache-2.0
"""The definition of a friction law: its own constants, and the contact that follows from them.

A law is arithmetic on parameters, and arithmetic is the same for numbers and for columns of them,
arrays (points,). Only choices are not; with `value_or` and `smaller` a law is written once for
both. Most laws consist of the constants of a `Contact`, in the form of `model.friction`; a law of
another form has its own rate, which uses them by name.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from stickslip_ros.physics.parameters import FrictionParameters
from stickslip_ros.physics.parameters.row import is_column

#: Parameters that a law fills where they are not set, or has no use for
LEFT_TO_LAW = ("sigma_0", "sigma_0ss", "z_ba", "z_ss")


class Law(NamedTuple):
    """A friction law. Constants and contact follow from the parameters and the normal force (N)."""

    #: The parameters with what the law takes for those of LEFT_TO_LAW that are not set, and None
    #: for those that it has no use for
    constants: Callable[[FrictionParameters, Any], FrictionParameters]
    #: The contact, from these
    contact: Callable[[FrictionParameters, Any], Contact]
    #: Of a law that is not of the form of `Contact`: z' (m/s) and the rate of its second state,
    #: from z (m), that state, w (m/s), a record with the constants of `Contact` and of ``rows`` by
    #: name, and Dupont's alpha, a function of z, w, z_ba, z_ss and printed. z' is odd in (z, w) and
    #: the second rate even: motion backwards is solved as its mirror image, with the same second
    #: state. That state is a time (s), by which its error is weighed. Both are smooth while w
    #: keeps its sign. It is compiled where it is used.
    rate: Callable[..., tuple[float, float]] | None = None
    states: int = 1  #: 1: z alone; 2: z and a second one, 0 at the start
    rows: type | None = None  #: frozen dataclass of constants that this law alone has
    #: Constants that are fitted by default, to runs at one preload
    free: tuple[str, ...] = ()
    several_free: tuple[str, ...] = ()  #: the same at several preloads, where they differ


def value_or(value: Any, own: Any) -> Any:
    """Return value where it is set, own where it is None or, in a column, nan."""
    if is_column(value):
        import numpy as np  # columns only: the table of parameters is read without numpy

        return np.where(np.isnan(value), own, value)
    return own if value is None else value


def smaller(a: Any, b: Any) -> Any:
    """Return the smaller of two values, element by element if one is an array."""
    if is_column(a) or is_column(b):
        import numpy as np  # as above

        return np.minimum(a, b)
    return min(a, b)


#: alpha after Dupont with constant z_ba and z_ss
ELASTOPLASTIC = 0
#: alpha after Dupont with z_ss = z_lim(w), Eq. 8
ELASTOPLASTIC_CALC = 1
#: alpha = 1 always, Eq. 3
ALWAYS_PLASTIC = 2
#: From here on: laws of another form, with a rate z' of their own
FOREIGN = 3


class Contact(NamedTuple):
    """Constants of the contact, in the order in which the compiled functions take them."""

    sigma_0: float  #: asperity stiffness, N/m
    sigma_1: float  #: asperity damping, N s/m
    sigma_2: float  #: viscous friction, N s/m
    z_ba: float  #: breakaway distance, m
    z_ss: float  #: steady-state deflection of alpha, m
    z_k: float  #: limit of the deflection at high speed, m
    z_s: float  #: limit of the deflection at rest, m
    v_s: float  #: Stribeck velocity, m/s
    kind: int  #: which alpha: ELASTOPLASTIC, ELASTOPLASTIC_CALC, ALWAYS_PLASTIC; or FOREIGN
    printed: int = 0  #: 1: alpha as the paper prints it, with z instead of its amount in the sine


#: The part of a `Contact` that is distances: z_ba, z_ss, z_k, z_s
DISTANCES = slice(3, 7)
