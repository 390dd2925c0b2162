# SPDX-License-Identifier: Apache-2.0
"""Constants of the contact from what can be measured or looked up (section 4.4, Fig. 10).

docs/derivations.md says what these are good for and what the paper leaves out. z_ba from a measured
0-amplitude needs runs of the model: ``simulation.operating_points``.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from stickslip_ros.base.arrays import add_up
from stickslip_ros.physics.parameters import ParameterError


def sigma_0_of_ringing(frequency: float, mass: float, decay: float = 0.0) -> float:
    """Return the asperity stiffness (N/m) that rings at a frequency (Hz) with a mass (kg); Eq. 11.

    With the decay (1/s) of the ringing it is exact; without, too low by the square of the damping
    ratio, 0.02 % for the drive of Table 1.
    """
    _above_zero(frequency=frequency, mass=mass)
    return mass * ((2.0 * math.pi * frequency) ** 2 + decay * decay)


def sigma_1_of_decay(decay: float, mass: float) -> float:
    """Return the asperity damping (N s/m) from the decay (1/s) of the ringing of a mass (kg)."""
    _above_zero(mass=mass)
    return 2.0 * mass * decay


class Elastic(NamedTuple):
    """Elastic constants of one body."""

    youngs_modulus: float  #: Pa
    poisson: float  #: Poisson's number

    @property
    def shear_modulus(self) -> float:
        """Of an isotropic body, Pa."""
        return self.youngs_modulus / (2.0 * (1.0 + self.poisson))


def contact_radius(preload: float, radius: float, one: Elastic, other: Elastic) -> float:
    """Return the radius (m) of the circle in which a sphere of a radius (m) presses a flat (Hertz).

    preload in N on this one contact.
    """
    _above_zero(preload=preload, radius=radius)
    compliance = add_up((1.0 - body.poisson**2) / body.youngs_modulus for body in (one, other))
    return (0.75 * preload * radius * compliance) ** (1.0 / 3.0)


def sigma_0_of_mindlin(preload: float, radius: float, one: Elastic, other: Elastic) -> float:
    """Return the tangential stiffness (N/m) of a sphere of a radius (m) on a flat, without slip.

    Textbook contact mechanics (Mindlin 1949): 8 times contact radius and reduced shear modulus.
    The paper ("Breguet 3-36") names only what it depends on, and that the preload (N) enters by its
    cubic root, as here.
    """
    compliance = add_up((2.0 - body.poisson) / body.shear_modulus for body in (one, other))
    return 8.0 * contact_radius(preload, radius, one, other) / compliance


def sigma_0_of_asperities(count: float, radius: float, body: Elastic) -> float:
    """Return the tangential stiffness (N/m) of asperities that touch a rigid flat side by side.

    Each is a circle of a radius (m), without slip: 8 times radius and shear modulus over 2 less
    Poisson's number (Mindlin 1949), in parallel. The paper ("Popov 7.35") names the same quantities
    and gives none of their values, so only the course over the material can be compared.
    """
    _above_zero(count=count, radius=radius)
    return count * 8.0 * radius * body.shear_modulus / (2.0 - body.poisson)


class Material(NamedTuple):
    """One row of Table 3."""

    name: str
    printed_modulus: float  #: Young's modulus as printed, kN/mm^2
    comment: str

    @property
    def youngs_modulus(self) -> float:
        """Young's modulus, Pa."""
        return self.printed_modulus * 1e9


#: Runner materials of Table 3. All of them ran against ruby. What the paper measured with them
#: (Fig. 6, 9, 10) is in its figures only: data, not a rule for parameters.
MATERIALS = (
    Material("Glass", 70.0, "microscope slide; of all these the largest 0-amplitude"),
    Material("AlMgSi0.5", 70.0, "aluminium alloy 6060"),
    Material("CuZn39Pb3", 97.0, "brass"),
    Material("Steel 1.4301", 200.0, "stainless, one of two that may leave the trends"),
    Material("Steel 1.4112", 215.0, "hardened to 55 on the Rockwell scale"),
    Material("Steel pin", 220.0, "dowel pin after DIN 6325"),
    Material("Al2O3", 350.0, "white ceramic"),
    Material("Tungsten", 400.0, "from an electrode for welding"),
    Material("Tungsten carbide", 600.0, "from a tool made to wear little"),
)


def _above_zero(**values: float) -> None:
    for name, value in values.items():
        if not 0.0 < value < math.inf:
            raise ParameterError(f"{name} is {value:g}; it has to be above 0")
