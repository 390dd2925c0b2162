# SPDX-License-Identifier: Apache-2.0
"""Steps that vary: the friction of the contact changes along the way and from slip to slip.

All distances at which the contact gives way (z_ba, z_ss and the limits of z) are multiplied by

    exp(surface_spread g(x) + slip_spread h(n))

g is a Gaussian field of unit variance along the runner's way, whose autocorrelation is
exp(-(dx / surface_length)^2); h(n) is normal and belongs to cycle n. Both hang on the seed alone,
so a runner that comes back meets the same surface. The factor changes where a drive cycle begins.
Stiffness and damping stay as they are, so what the contact stores, sigma_0 z^2 / 2, does not change
with it, and energy is never created.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from stickslip_ros.model.friction import Contact
from stickslip_ros.model.plant import Plant
from stickslip_ros.parameters import FrictionParameters

#: Nodes of the field in a correlation length, and how many of them on either side count
_PER_LENGTH, _REACH = 2, 10


class Surface(NamedTuple):
    """What varies, and how much."""

    spread: float  #: standard deviation of the logarithm along the way
    length: float  #: correlation length, m
    slip_spread: float  #: standard deviation of the logarithm from cycle to cycle
    seed: int

    @classmethod
    def of(cls, p: FrictionParameters) -> Surface | None:
        """Return the surface of the parameters; None if all steps are alike."""
        if not (p.surface_spread or p.slip_spread):
            return None
        return cls(p.surface_spread, p.surface_length, p.slip_spread, p.surface_seed)

    def factor(self, x: float, cycle: int) -> float:
        """Return the factor of a cycle that begins with the runner at x (m)."""
        exponent = 0.0
        if self.spread:
            exponent += self.spread * self._field(x)
        if self.slip_spread:
            exponent += self.slip_spread * _normal(self.seed, 1, cycle)
        return math.exp(exponent)

    def _field(self, x: float) -> float:
        """Return g(x): white noise on nodes, smoothed by a bell of half the correlation length."""
        place = x / self.length * _PER_LENGTH
        nodes = range(math.floor(place) - _REACH, math.floor(place) + _REACH + 2)
        bells = [math.exp(-0.5 * (place - node) ** 2) for node in nodes]
        total = sum(b * _normal(self.seed, 0, node) for b, node in zip(bells, nodes, strict=True))
        return total / math.sqrt(sum(b * b for b in bells))

    def varied(self, plant: Plant, x: float, cycle: int) -> Plant:
        """Return the plant of a cycle that begins with the runner at x (m)."""
        factor, contact = self.factor(x, cycle), plant.contact
        return plant._replace(
            contact=Contact(
                contact.sigma_0, contact.sigma_1, contact.sigma_2,
                factor * contact.z_ba, factor * contact.z_ss,
                factor * contact.z_k, factor * contact.z_s,
                contact.v_s, contact.kind, contact.printed,
            )
        )  # fmt: skip


@lru_cache(maxsize=4096)
def _normal(seed: int, what: int, number: int) -> float:
    """Return a normal number that hangs on its arguments alone."""
    # The legacy generator: its numbers are the same in every version of numpy.
    return float(np.random.RandomState([seed, what, number % 2**32]).standard_normal())
