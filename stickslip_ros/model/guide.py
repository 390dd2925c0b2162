# SPDX-License-Identifier: Apache-2.0
"""The six contacts that guide a prismatic runner (Appendix, Eq. 17-31, Fig. 16).

A, B, C, D are the contacts of the fixed side, E and F those of the preloaded one; each is a normal
force (N), its friction mu times as large along the axis. The sliding faces stand at right angles,
so every normal is at 45 degrees to the transverse axes. alpha is the angle of the axis against the
vertical: pi/2 is a level axis. It is **not** the parameter ``inclination`` of an axis, which is the
angle of +x above the horizontal: alpha = pi/2 - inclination.

Two systems of equations for the six forces, rows as in Eq. 24 and 30 (their print is garbled, so
the rows here are built from the balances they come from):

1. Eq. 17 to 22. Friction carries the runner along the axis (Eq. 19), so the motion sets the sum of
   the normal forces (Eq. 29), and the preload plays no part.
2. Eq. 27 instead of Eq. 19, and the moments of friction left out of Eq. 21 (in Eq. 22 they cancel
   by Eq. 17). This one gives Table 5.
"""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass, fields

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.parameters import ParameterError

#: Standard gravity, m/s^2
GRAVITY = 9.80665
_ROOT_2 = math.sqrt(2.0)


@dataclass(frozen=True)
class Geometry:
    """Lengths of Fig. 16 b, m.

    Table 4 is missing from our copy of the paper. The defaults are one choice with the only thing
    that Table 5 gives of it, (a - b) / (2 e) = 0.9276; b and c have no bearing on it alone.
    """

    a: float = 15e-3  #: distance of the contacts along the axis, Eq. 22
    b: float = 5.724e-3  #: Eq. 20, 21
    c: float = 5e-3  #: width between the contacts, Eq. 25
    e: float = 5e-3  #: arm of E and F, Eq. 20

    def __post_init__(self) -> None:
        """Refuse lengths that are not above 0. Raises ParameterError."""
        for name in ("a", "b", "c", "e"):
            value = getattr(self, name)
            if not 0.0 < value < math.inf:
                raise ParameterError(f"{name} of the guide is {value:g} m; it has to be above 0")

    @property
    def lever(self) -> float:
        """(a - b) / (2 e): what the weight's arm makes of it at E and F (Eq. 20)."""
        return (self.a - self.b) / (2.0 * self.e)


@dataclass(frozen=True)
class ContactForces:
    """Normal forces of the six contacts, N."""

    a: float  #: contact A
    b: float  #: contact B
    c: float  #: contact C
    d: float  #: contact D
    e: float  #: contact E
    f: float  #: contact F

    @property
    def total(self) -> float:
        """Sum of the six, N: what the lumped contact of the model may be loaded with."""
        return float(sum(astuple(self)))

    @classmethod
    def of(cls, matrix: NDArray[np.float64], right: NDArray[np.float64]) -> ContactForces:
        """Return the forces of a system of equations.

        Raises ParameterError where the matrix is singular, with its rank, and where a contact would
        have to pull, with the names of such contacts.
        """
        rank = int(np.linalg.matrix_rank(matrix))
        if rank < len(right):
            raise ParameterError(
                f"the equations of the guide are singular: rank {rank} of {len(right)}; contacts "
                "that coincide do not guide a runner"
            )
        forces = ContactForces(*np.linalg.solve(matrix, right).tolist())
        if not math.isfinite(forces.total):
            raise ParameterError(
                "the forces of the guide are not finite; check its lengths, mass and preload"
            )
        pulling = [
            f"{field.name.upper()} ({getattr(forces, field.name):.4g} N)"
            for field in fields(forces)
            if getattr(forces, field.name) < 0.0
        ]
        if pulling:
            raise ParameterError(
                f"contact {', '.join(pulling)} would have to pull: the runner lifts off there; "
                "raise the preload, or make the runner lighter or its overhang a - b smaller"
            )
        return forces


def preload_ratio(forces: ContactForces, preload: float) -> float:
    """Return the sum of the normal forces per preload (N) that a load cell reads, Table 5."""
    return forces.total / preload


def system_2(
    geometry: Geometry, mass: float, alpha: float, preload: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return matrix (6, 6) and right side (6,) of Eq. 30, 31, as M (A B C D E F) = R in N.

    mass kg, alpha rad, preload N.
    """
    weight = mass * GRAVITY
    matrix = np.array(
        [
            [1.0, 1.0, 1.0, 1.0, -1.0, -1.0],
            [1.0, -1.0, 1.0, -1.0, 1.0, -1.0],
            [0.0, 0.0, 0.0, 0.0, 1.0, -1.0],
            [1.0, -1.0, -1.0, 1.0, 0.0, 0.0],
            [-1.0, -1.0, 1.0, 1.0, 0.0, 0.0],
            [0.0, 0.0, 0.0, 0.0, 1.0 / _ROOT_2, 1.0 / _ROOT_2],
        ]
    )
    right = np.zeros(6)
    right[1] = _ROOT_2 * weight * math.sin(alpha)
    right[2] = weight * geometry.lever * math.sin(alpha)
    right[5] = preload
    return matrix, right


def forces_by_preload(
    geometry: Geometry, mass: float, alpha: float, preload: float
) -> ContactForces:
    """Return the six forces of a preloaded runner (Eq. 30, 31; Table 5).

    mass kg, alpha rad, preload N. Raises ParameterError.
    """
    for name, value, unit in (("mass", mass, "kg"), ("preload", preload, "N")):
        if not 0.0 < value < math.inf:
            raise ParameterError(f"{name} of the guide is {value:g} {unit}; it has to be above 0")
    if not math.isfinite(alpha):
        raise ParameterError(f"alpha of the guide is {alpha} rad; it has to be a finite number")
    return ContactForces.of(*system_2(geometry, mass, alpha, preload))
