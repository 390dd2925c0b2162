# SPDX-License-Identifier: Apache-2.0
"""A contact that varies: along the track, from slip to slip, with dwell and rate, by wear.

All distances at which the contact gives way (z_ba, z_ss and the limits of z) are multiplied by

    exp(surface_spread g(x) + slip_spread h(n))
    (1 + dwell_growth log10(1 + dwell / dwell_start) + rate_growth log10(1 + rate / rate_start))
    exp(-wear_rate s)

g is a Gaussian field of unit variance along the track of the runner, whose autocorrelation is
exp(-(dx / surface_length)^2); h(n) is a normal number for cycle n. Both depend on the seed alone,
so a runner that comes back meets the same surface. The dwell is the time from the end of the last
slip to the beginning of the next one; the contact sticks meanwhile. The rate is that at which the
slip is commanded. Strength that grows with the logarithm of the time of rest, and changes with that
of the rate, is the friction of Dieterich (J. Geophys. Res. 77 (1972) 3690) and Ruina (J. Geophys.
Res. 88 (1983) 10359). s is the distance that the contact has slid since the start. The depth worn
off goes with load and distance (J. F. Archard, J. Appl. Phys. 24 (1953) 981); a preload that comes
from a spring loses a fraction of itself for each metre, and the breakaway goes with it.

The factor changes where a drive cycle begins. Stiffness and damping stay the same, and so does the
elastic energy sigma_0 z^2 / 2: no energy is created.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.base.arrays import Array
from stickslip_ros.base.compiled import compiled
from stickslip_ros.physics.parameters import FrictionParameters

#: Nodes of the field in a correlation length, and how many of them on either side count
_PER_LENGTH, _REACH = 2, 10
_NODES = 2 * _REACH + 2
#: Normal numbers that are drawn at a time
_BLOCK = 256
#: Factor by which wear changes the breakaway at most: beyond, it is another pair of surfaces
_MOST_WORN = 100.0


class CycleStart(NamedTuple):
    """When and where a contact is taken, for a whole cycle."""

    x: float  #: position of the runner at the beginning, m
    cycle: int  #: number of the cycle since the start
    dwell: float = 0.0  #: time at rest before the slip, s
    rate: float = 0.0  #: of the slip, m/s
    slid: float = 0.0  #: distance that the contact has slid since the start, m


class Surface(NamedTuple):
    """The variation of the contact."""

    spread: float  #: standard deviation of the logarithm along the track
    length: float  #: correlation length, m
    slip_spread: float  #: standard deviation of the logarithm from cycle to cycle
    seed: int
    dwell_growth: float = 0.0  #: share a decade of the dwell
    dwell_start: float = 1.0  #: s
    rate_growth: float = 0.0  #: share a decade of the rate
    rate_start: float = 1.0  #: m/s
    wear_rate: float = 0.0  #: share a metre, 1/m

    @classmethod
    def of(cls, p: FrictionParameters) -> Surface | None:
        """Return the surface of the parameters; None if all steps are alike."""
        if not (
            p.surface_spread or p.slip_spread or p.dwell_growth or p.rate_growth or p.wear_rate
        ):
            return None
        return cls(
            p.surface_spread, p.surface_length, p.slip_spread, p.surface_seed,
            p.dwell_growth, p.dwell_start, p.rate_growth, p.rate_start, p.wear_rate,
        )  # fmt: skip

    def factor(self, moment: CycleStart) -> float:
        """Return the factor of the cycle that begins at a moment."""
        exponent = 0.0
        if self.spread:
            exponent += self.spread * self._field(moment.x)
        if self.slip_spread:
            exponent += self.slip_spread * _normal(self.seed, 1, moment.cycle)
        wear = min(-self.wear_rate * moment.slid, _MOST_WORN)  # so that its exponential is finite
        worn = min(max(math.exp(wear), 1.0 / _MOST_WORN), _MOST_WORN)
        return math.exp(exponent) * self.ageing_factor(moment.dwell, moment.rate) * worn

    def ageing_factor(self, dwell: float, rate: float) -> float:
        """Return the factor of a contact that slips at a rate (m/s) after a dwell (s) at rest."""
        grown = self.dwell_growth * math.log10(1.0 + dwell / self.dwell_start)
        return 1.0 + grown + self.rate_growth * math.log10(1.0 + rate / self.rate_start)

    def _field(self, x: float) -> float:
        """Return g(x): white noise on nodes, smoothed by a bell of half the correlation length."""
        place = x / self.length * _PER_LENGTH
        first = math.floor(place) - _REACH
        block, at = divmod(first, _BLOCK)
        numbers = _normals(self.seed, 0, block % 2**32)
        if at + _NODES > _BLOCK:
            numbers = np.concatenate([numbers, _normals(self.seed, 0, (block + 1) % 2**32)])
        return float(_smoothed(numbers[at : at + _NODES], place - first))


def _normal(seed: int, what: int, number: int) -> float:
    """Return a normal number that depends on its arguments alone."""
    block, place = divmod(number, _BLOCK)
    return float(_normals(seed, what, block % 2**32)[place])


@lru_cache(maxsize=64)
def _normals(seed: int, what: int, block: int) -> Array:
    """Return a block of normal numbers."""
    # The legacy generator: its numbers are the same in every version of numpy.
    return np.random.RandomState([seed, what, block]).standard_normal(_BLOCK)


@compiled
def _smoothed(numbers: NDArray, place: float) -> float:
    """Return the sum of numbers at 0, 1, .. under a bell around a place, of unit variance."""
    total = square = 0.0
    for node in range(len(numbers)):
        bell = math.exp(-0.5 * (place - node) ** 2)
        total += bell * numbers[node]
        square += bell * bell
    return total / math.sqrt(square)
