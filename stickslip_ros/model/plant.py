# SPDX-License-Identifier: Apache-2.0
"""The axis as the equations see it: contact, moved mass and loads.

m v' = -F - k x + F_ext        (Eq. 5 with the sign set right)
w    = v - u'                  (Eq. 6)
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.model.friction import Contact, contact_of
from stickslip_ros.parameters import Values

#: Standard gravity, m/s^2
GRAVITY = 9.80665


class Plant(NamedTuple):
    """A contact with its runner and loads."""

    contact: Contact
    mass: float  #: runner and payload, kg
    force: float  #: external force on the runner, N: constant part and gravity along the axis
    spring: float  #: stiffness of a spring at rest for x = 0, N/m

    def coefficients(self) -> NDArray[np.float64]:
        """Return shape (12,): the contact, then mass, force, spring."""
        return np.array([*self.contact, self.mass, self.force, self.spring])

    @property
    def ringing_frequency(self) -> float:
        """Hz of the runner on its elastic contact (Eq. 10, 11), damping included; 0 overdamped."""
        damping = (self.contact.sigma_1 + self.contact.sigma_2) / (2.0 * self.mass)
        square = (self.contact.sigma_0 + self.spring) / self.mass - damping**2
        return math.sqrt(max(square, 0.0)) / (2.0 * math.pi)


def plant_of(p: Values) -> Plant:
    """Build the plant from a full set of parameters; ParameterError where they contradict."""
    mass = p["mass"] + p["payload"]
    return Plant(
        contact=contact_of(p),
        mass=mass,
        force=p["force"] - mass * GRAVITY * math.sin(p["inclination"]),
        spring=p["spring"],
    )
