# SPDX-License-Identifier: Apache-2.0
"""The CEIM whose contact ages while it rests and grows young while it slides.

    theta' = 1 - |w| theta / d_c          (Dieterich's ageing; theta is 0 at the start)
    a      = 1 + beta ln(1 + theta / theta_0)

The age a multiplies the distances of the CEIM: the limit of the deflection f mu / sigma_0ss, z_ba
and z_ss. With beta = 0 it is the CEIM. Rate and state friction after J. H. Dieterich, J. Geophys.
Res. 84 (1979) 2161; without the logarithm of the velocity, which has no value at a reversal.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from stickslip_ros.physics.laws.ceim import CEIM
from stickslip_ros.physics.laws.law import Law
from stickslip_ros.physics.parameters.row import number


@dataclass(frozen=True)
class Ageing:
    """Constants of the contact that ages."""

    # fmt: off
    beta: float = number(
        0.01, "", 0.0, 1.0,
        "ageing of ceim_ageing: growth of the breakaway per e-fold of the age, typically 0.01",
        reason="measured ones lie between 0.005 and 0.05")
    d_c: float = number(
        1e-7, "m", 1e-10, 1e-3, "of ceim_ageing: distance slid that renews the contact",
        reason="an atom, up to a groove")
    theta_0: float = number(
        1e-3, "s", 1e-9, 1e6, "of ceim_ageing: age from which on the breakaway grows",
        reason="faster than any atom jumps, or longer than any test")
    # fmt: on


def _rate(z: float, theta: float, w: float, c: Any, alpha: Any) -> tuple[float, float]:
    """Return z' (m/s) and theta' at z (m), age theta (s) and w (m/s)."""
    # A step that tries too far may ask for an age below 0.
    age = 1.0 + c.beta * math.log1p(max(theta, 0.0) / c.theta_0)
    share = alpha(z, w, age * c.z_ba, age * c.z_ss, c.printed)
    return w - share * abs(w) / (age * c.z_k) * z, 1.0 - abs(w) * theta / c.d_c


CEIM_AGEING = Law(CEIM.constants, CEIM.contact, _rate, states=2, rows=Ageing)
