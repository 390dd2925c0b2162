# SPDX-License-Identifier: Apache-2.0
"""The axis as the equations see it: contact, moved mass and loads.

m v' = -F - k x + F_ext        (Eq. 5 with the sign set right)
w    = v - u'                  (Eq. 6)
"""

from __future__ import annotations

import math
from itertools import repeat
from typing import Any, NamedTuple

import numpy as np

from stickslip_ros.physics.laws import own_constants, value_or
from stickslip_ros.physics.laws.law import Contact
from stickslip_ros.physics.model.contacts import (
    GRAVITY,
    build_contacts,
    columns_of_contacts,
    mean_contact,
    scale_contact,
)
from stickslip_ros.physics.model.friction import contact_columns, contact_of, has_own_rate
from stickslip_ros.physics.parameters import ParameterError, Parameters

#: Acceleration (m/s^2) that a load may give a runner without friction
FASTEST = 1e6
#: Stiffness (N/m) of the stiffest spring
STIFFEST = 1e8
#: A load above this fraction of the friction may keep the runner sliding; under less load the
#: runner comes to rest within a cycle.
NEARLY_SLIDING = 0.5
#: Springs softer than this (N/m) count as none: pushed by a millimetre they return a micronewton.
SLACK = 1e-3


class Plant(NamedTuple):
    """A contact with its runner and loads; from `Plant.column` arrays, one entry a point."""

    contact: Contact  #: for several contacts their `mean_contact`
    mass: float  #: runner and payload, kg
    force: float  #: external force on the runner, N: constant part and gravity along the axis
    spring: float  #: stiffness of a spring at rest for x = 0, N/m
    #: several contacts, or the single contact of a law with its own rate; else empty
    contacts: tuple[Contact, ...] = ()
    own: tuple[Any, ...] = ()  #: values of `laws.OWN_CONSTANTS`, which only some laws have

    def points(self, count: int) -> list[Plant]:
        """Split a column into the plants of its points."""

        def column(value: Any) -> list[Any]:
            return np.broadcast_to(value, count).tolist()

        def column_of(contact: Contact) -> list[Contact]:
            return [Contact._make(point) for point in zip(*map(column, contact), strict=True)]

        none: Any = repeat(())
        parts = column_of(self.contact), column(self.mass), column(self.force), column(self.spring)
        contacts = zip(*map(column_of, self.contacts), strict=True) if self.contacts else none
        own = zip(*map(column, self.own), strict=True) if self.own else none
        return [Plant(*point) for point in zip(*parts, contacts, own, strict=False)]

    @property
    def ringing_frequency(self) -> float:
        """Hz of the runner on its elastic contact (Eq. 10, 11), damping included; 0 overdamped."""
        damping = (self.contact.sigma_1 + self.contact.sigma_2) / (2.0 * self.mass)
        square = (self.contact.sigma_0 + self.spring) / self.mass - damping * damping
        frequency: Any = np.sqrt(np.maximum(square, 0.0)) / (2.0 * math.pi)
        return frequency if np.ndim(frequency) else float(frequency)

    @classmethod
    def column(cls, p: Parameters) -> Plant:
        """Build the plants of many operating points: numbers in p may be columns (points,).

        Each point is the same as from `Plant.of`, to the last bit. ``friction.is_defined`` tells
        which contacts are possible.
        """
        contacts = columns_of_contacts(p)
        contact = mean_contact(contacts) if contacts else contact_columns(p.friction)
        return _plant(p, contact, contacts)

    @classmethod
    def of(cls, p: Parameters) -> Plant:
        """Build the plant; ParameterError where the parameters contradict each other."""
        contacts = build_contacts(p)
        contact = mean_contact(contacts) if contacts else contact_of(p.friction)
        plant = _plant(p, contact, contacts)
        acceleration = abs(plant.force) / plant.mass
        if not acceleration <= FASTEST:
            raise ParameterError(
                f"the load of {plant.force:g} N would speed up the runner of {plant.mass:g} kg by "
                f"{acceleration:g} m/s^2, {FASTEST:g} m/s^2 is the upper limit, a hundred thousand "
                "times gravity: lower force or raise mass"
            )
        if not plant.spring <= STIFFEST:
            raise ParameterError(
                f"spring is {plant.spring:g} N/m, {STIFFEST:g} N/m is the upper limit, that of a "
                "block of steel: lower it"
            )
        return plant


def scale_distances(plant: Plant, factor: Any) -> Plant:
    """Return a plant with z_ba, z_ss and the limits of z of its contacts multiplied by a factor."""
    return plant._replace(
        contact=scale_contact(plant.contact, factor),
        contacts=tuple(scale_contact(contact, factor) for contact in plant.contacts),
    )


def _plant(p: Parameters, contact: Contact, contacts: tuple[Contact, ...]) -> Plant:
    runner = p.runner
    if not contacts and has_own_rate(p.friction):
        contacts = (contact,)
    mass = runner.mass + runner.payload
    spring = value_or(runner.spring, 0.0)
    plant = Plant(
        contact=contact,
        mass=mass,
        force=runner.force - mass * GRAVITY * _sine(runner.inclination),
        spring=spring * (spring >= SLACK),
        contacts=contacts,
        own=own_constants(p.friction) if contacts else (),
    )
    return scale_distances(plant, 1.0 + p.friction.friction_temperature * p.actuator.warmth)


def _sine(angle: Any) -> Any:
    """Return the sine of an angle (rad) or of each in an array.

    numpy's own sine may differ from that of ``math`` in the last bit.
    """
    if isinstance(angle, np.ndarray):
        return np.array([math.sin(one) for one in angle.flat]).reshape(angle.shape)
    return math.sin(angle)
