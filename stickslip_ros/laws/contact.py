# SPDX-License-Identifier: Apache-2.0
"""The constants of a contact, which a friction law computes from parameters and normal force.

Most laws consist of these constants, in the form of `model.friction.laws`. A law of another form
has its own rate, which uses them by name.
"""

from __future__ import annotations

from typing import NamedTuple

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
    printed: int = 0  #: 1: alpha as the paper prints it, with z instead of |z| in its sine


#: The part of a `Contact` that is distances: z_ba, z_ss, z_k, z_s
DISTANCES = slice(3, 7)
