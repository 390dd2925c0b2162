# SPDX-License-Identifier: Apache-2.0
"""One form for most friction laws (Eq. 1, 3, 7, 16), as pure functions of numbers.

Such a law is nothing but the constants of this form, a `Contact`:

    F  = sigma_0 z + sigma_1 z' + sigma_2 w                 (Eq. 1)
    z' = w - alpha(z, w) |w| / z_lim(w) z                   (Eq. 3, 7, 16)
    z_lim(w) = z_k + (z_s - z_k) exp(-(w / v_s)^2)          (Eq. 4 divided by the stiffness)

-F acts on the runner. The paper prints +F in Eq. 5 and leaves out |w| in Eq. 16; both would feed
energy into the runner, see docs/paper_errata.md.
"""

from __future__ import annotations

import math
from typing import TypeVar

import numpy as np

from stickslip_ros.compiled import compiled
from stickslip_ros.laws.contact import ALWAYS_PLASTIC, ELASTOPLASTIC_CALC, Contact

#: A number, or one with an imaginary part that becomes a derivative, see `solver.complex_steps`
Number = TypeVar("Number", float, complex)


@compiled
def z_limit(w: Number, z_k: Number, z_s: Number, v_s: Number) -> Number:
    """Return the deflection (m) that steady plastic sliding at w (m/s) tends to; Eq. 4."""
    if z_s == z_k:
        return z_k
    ratio = w / v_s
    return z_k + (z_s - z_k) * np.exp(-ratio * ratio)


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
def alpha_at(angle: Number) -> tuple[Number, Number]:
    """Return Dupont's alpha between its ends, and its derivative by the angle.

    The angle is pi (|z| - z_ba) / (z_ss - z_ba): 0 at z_ba, pi at z_ss.
    """
    return 0.5 - 0.5 * np.cos(angle), 0.5 * np.sin(angle)


@compiled
def sine_start(z: float, z_ba: float, printed: int) -> float:
    """Return the |z| (m) at which the sine of alpha begins on the side of z.

    As printed and for z < 0, 1 + sin(pi (z - (z_ss + z_ba) / 2) / (z_ss - z_ba)) is the sine of |z|
    moved by 2 z_ba.
    """
    return -z_ba if printed != 0 and z < 0.0 else z_ba


@compiled
def alpha_of(z: float, w: float, contact: Contact | np.record) -> float:
    """Return alpha of any law at deflection z (m) and differential velocity w (m/s)."""
    if contact.kind >= ALWAYS_PLASTIC:
        return 1.0
    z_ss = contact.z_ss
    if contact.kind == ELASTOPLASTIC_CALC:
        z_ss = z_limit(w, contact.z_k, contact.z_s, contact.v_s)
    return alpha(z, w, contact.z_ba, z_ss, contact.printed)
