# SPDX-License-Identifier: Apache-2.0
"""Several contacts under one runner, each with its share of the preload and its own constants.

Eq. 13, 14 and 16 were found for a whole runner and its preload f. Contact i of n with the share q_i
of the preload is modelled as one n-th of a runner with the preload n q_i f: its breakaway distance
and its limit of z are those of that runner, its stiffness and damping are one n-th. So n contacts
with equal shares are the one contact of the paper, and the stiffness of Eq. 14, which is linear,
adds up to that of the whole runner whatever the shares.

Shares are equal, or those of the six contacts of a guide (`guide`, Appendix). With
``contact_spread``, all distances of a contact are besides multiplied by exp(spread n_i), where n_i
is a normal number that belongs to ``surface_seed`` and contact i.
"""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass, fields, replace
from typing import Any

import numpy as np

from stickslip_ros.base.arrays import Array, add_up
from stickslip_ros.physics.laws.law import DISTANCES, Contact
from stickslip_ros.physics.model.friction import contact_columns, contact_of, is_defined
from stickslip_ros.physics.parameters import FrictionParameters, ParameterError, Parameters

#: Sets the normal numbers of contacts apart from others of the same seed
_OF_CONTACTS = 2
_GUIDED = 6


def scale_contact(contact: Contact, factor: Any) -> Contact:
    """Return a contact that gives way at distances a factor longer."""
    constants: list[Any] = list(contact)
    constants[DISTANCES] = [factor * one for one in constants[DISTANCES]]
    return Contact._make(constants)


def build_contacts(p: Parameters) -> tuple[Contact, ...]:
    """Return the contacts of the runner, none if it rests on one only.

    Raises ParameterError where a contact cannot be.
    """
    count = p.friction.contacts
    if count == 1:
        return ()
    found = []
    for k, (friction, factor) in enumerate(_each(p)):
        try:
            contact = contact_of(friction, p.friction.preload / friction.preload)
        except ParameterError as error:
            raise ParameterError(
                f"contact {k + 1} of {count}, with {friction.preload / count:.3g} N of the "
                f"preload: {error}"
            ) from None
        if contact.printed:  # it jumps, which no step of several contacts ends at
            raise ParameterError(
                f"contacts is {count} and alpha_form is printed: several contacts need alpha of "
                "Dupont; set alpha_form to dupont, or contacts to 1"
            )
        found.append(_part(contact, count, factor))
    return tuple(found)


def columns_of_contacts(p: Parameters) -> tuple[Contact, ...]:
    """Return the contacts like `build_contacts`, for parameters with columns: arrays (points,).

    Constants are nan for impossible contacts.
    """
    count = p.friction.contacts
    if count == 1:
        return ()
    found = []
    for friction, factor in _each(p):
        contact = contact_columns(friction)
        possible = is_defined(contact) & (contact.printed == 0)
        sigma_0: Any = np.where(possible, contact.sigma_0, math.nan)
        found.append(_part(contact._replace(sigma_0=sigma_0), count, factor))
    return tuple(found)


def mean_contact(contacts: tuple[Contact, ...]) -> Contact:
    """Return the single contact that represents several; its z is the mean weighted by stiffness.

    Stiffness and damping are the sums; distances are means by stiffness, so that the limit of the
    friction force, sigma_0 z_lim, is the sum of those of the contacts.
    """
    added = ("sigma_0", "sigma_1", "sigma_2")
    sums = {name: add_up(getattr(c, name) for c in contacts) for name in added}
    means = {
        name: add_up(c.sigma_0 * getattr(c, name) for c in contacts) / sums["sigma_0"]
        for name in Contact._fields[DISTANCES]
    }
    return contacts[0]._replace(**sums, **means)


def _each(p: Parameters) -> list[tuple[FrictionParameters, Any]]:
    """Return what the law is asked for each contact, and the factor of its distances."""
    f, count = p.friction, p.friction.contacts
    # The legacy generator: its numbers are the same in every version of numpy.
    normals = np.random.RandomState([f.surface_seed, _OF_CONTACTS]).standard_normal(count)
    return [
        (replace(f, preload=f.preload * (count * share)), _exp(f.contact_spread * chance))
        for share, chance in zip(shares_of(p), normals.tolist(), strict=True)
    ]


def _exp(x: Any) -> Any:
    """Return the exponential of a number or a column (points,), not by NumPy, see `arithmetic`."""
    return np.array([math.exp(one) for one in x]) if np.ndim(x) else math.exp(x)


def _part(contact: Contact, count: int, factor: Any) -> Contact:
    """Return one of so many contacts, of that of a runner with n times its share of the preload."""
    own = contact._replace(
        sigma_0=contact.sigma_0 / count,
        sigma_1=contact.sigma_1 / count,
        sigma_2=contact.sigma_2 / count,
    )
    return scale_contact(own, factor if np.ndim(factor) else float(factor))


def shares_of(p: Parameters) -> list[Any]:
    """Return the share of the preload of each contact; they add up to 1.

    Of columns arrays (points,), nan where a contact of the guide would have to pull. Raises
    ParameterError.
    """
    f = p.friction
    if f.contact_shares == "equal":
        return [1.0 / f.contacts] * f.contacts
    if f.contacts != _GUIDED:
        raise ParameterError(
            f"contacts is {f.contacts} and contact_shares is guide: the guide of the paper has "
            f"{_GUIDED} contacts; set contacts to {_GUIDED} or contact_shares to equal"
        )
    mass = p.runner.mass + p.runner.payload
    loads = np.broadcast_arrays(mass, p.runner.inclination, f.preload)
    if not loads[0].ndim:
        return _guided(*(float(one) for one in loads))
    columns = np.full((_GUIDED, len(loads[0])), math.nan)
    for k, load in enumerate(zip(*(one.tolist() for one in loads), strict=True)):
        try:
            columns[:, k] = _guided(*load)
        except ParameterError:
            continue
    return list(columns)


def _guided(mass: float, inclination: float, preload: float) -> list[float]:
    """Return the shares of the contacts A to F of a runner; kg, rad, N."""
    try:
        forces = forces_by_preload(Geometry(), mass, 0.5 * math.pi - inclination, preload)
    except ParameterError as error:
        raise ParameterError(f"contact_shares is guide: {error}; or set it to equal") from None
    # Forces that are equal by symmetry then are, to the last bit: such contacts slide together.
    return [round(force / forces.total, 12) for force in astuple(forces)]


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
        return float(add_up(astuple(self)))

    @classmethod
    def of(cls, matrix: Array, right: Array) -> ContactForces:
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
        forces = ContactForces(*_solve(matrix.tolist(), right.tolist()))
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


def _solve(matrix: list[list[float]], right: list[float]) -> list[float]:
    """Return the solution of a regular system (n, n), (n,), by elimination in a fixed order."""
    rows = [[*row, value] for row, value in zip(matrix, right, strict=True)]
    for k in range(len(rows)):
        pivot = max(range(k, len(rows)), key=lambda i: abs(rows[i][k]))
        rows[k], rows[pivot] = rows[pivot], rows[k]
        for i in range(len(rows)):
            if i != k:
                factor = rows[i][k] / rows[k][k]
                rows[i] = [a - factor * b for a, b in zip(rows[i], rows[k], strict=True)]
    return [row[-1] / row[k] for k, row in enumerate(rows)]


def preload_ratio(forces: ContactForces, preload: float) -> float:
    """Return the sum of the normal forces per preload (N) that a load cell reads, Table 5."""
    return forces.total / preload


def system_2(geometry: Geometry, mass: float, alpha: float, preload: float) -> tuple[Array, Array]:
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
