# SPDX-License-Identifier: Apache-2.0
"""What several contacts are made of: shares of the preload, forces of the guide, constants."""

import math
import re
from dataclasses import astuple
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from table_1 import table_1

from stickslip_ros.physics.model import GRAVITY, Plant
from stickslip_ros.physics.model.contacts import (
    ContactForces,
    Geometry,
    forces_by_preload,
    preload_ratio,
    shares_of,
    system_2,
)
from stickslip_ros.physics.model.plant import scale_distances
from stickslip_ros.physics.parameters import ParameterError, Parameters

GUIDE: dict[str, Any] = {"contacts": 6, "contact_shares": "guide"}


def test_shares_of_the_guide_are_those_of_table_5() -> None:
    """The printed forces, 3 g and 0.2 N, over their sum; equal ones are equal to the last bit."""
    shares = shares_of(table_1(**GUIDE, mass=3e-3, preload=0.2))
    printed = np.array([74.3, 67.1, 74.3, 67.1, 155.1, 127.8])
    assert shares == pytest.approx(printed / printed.sum(), abs=1e-4)
    assert (shares[0], shares[1]) == (shares[2], shares[3])
    assert sum(shares) == pytest.approx(1.0)


def test_a_vertical_axis_loads_its_guide_evenly() -> None:
    """Without the weight across, A to D are equal, and so are E and F."""
    a, b, c, d, e, f = shares_of(table_1(**GUIDE, inclination=0.5 * np.pi))
    assert a == pytest.approx(b) == pytest.approx(c) == pytest.approx(d) == pytest.approx(0.125)
    assert e == pytest.approx(f) == pytest.approx(0.25)


def test_constants_are_those_of_eq_13_to_16_for_six_times_the_share() -> None:
    p = table_1(**GUIDE, mass=3e-3, preload=0.2)
    for share, contact in zip(shares_of(p), Plant.of(p).contacts, strict=True):
        f = 6.0 * share * 0.2
        assert contact.z_ba == pytest.approx(2e-8 * f + 1e-8)
        assert contact.z_ss == pytest.approx(2.0 * contact.z_ba)
        assert contact.sigma_0 == pytest.approx((5e6 * f + 7e6) / 6.0)
        assert contact.z_k == contact.z_s == pytest.approx(0.2 * f / 1e7)
        assert contact.sigma_1 == pytest.approx(5.0 / 6.0)


def test_sums_are_those_of_the_one_contact() -> None:
    """Stiffness, damping and, of equal contacts, all else."""
    one = Plant.of(table_1(preload=1.0, sigma_2=0.1)).contact
    for values in (GUIDE, {"contacts": 6}, {"contacts": 2, "contact_spread": 0.3}):
        many = Plant.of(table_1(preload=1.0, sigma_2=0.1, **values)).contact
        assert many[:3] == pytest.approx(one[:3], rel=1e-11)
    assert tuple(Plant.of(table_1(preload=1.0, contacts=5)).contact[3:8]) == pytest.approx(
        Plant.of(table_1(preload=1.0)).contact[3:8], rel=1e-12
    )


def test_the_spread_has_its_size_and_hangs_on_the_seed() -> None:
    def factors(**values: Any) -> list[float]:
        p = table_1(contacts=16, contact_spread=0.2, **values)
        return [contact.z_ba / 18e-9 for contact in Plant.of(p).contacts]

    drawn = np.log([factors(surface_seed=seed) for seed in range(60)])
    assert drawn.std() == pytest.approx(0.2, rel=0.1)
    assert abs(drawn.mean()) < 0.02
    assert factors(surface_seed=3) == factors(surface_seed=3) != factors(surface_seed=4)


def test_a_surface_varies_all_contacts_alike() -> None:
    plant = Plant.of(table_1(**GUIDE))
    longer = scale_distances(plant, 1.5)
    for before, after in zip(
        (plant.contact, *plant.contacts), (longer.contact, *longer.contacts), strict=True
    ):
        assert after[3:7] == pytest.approx([1.5 * one for one in before[3:7]])
        assert after[:3] == before[:3]


def test_columns_are_each_of_their_points() -> None:
    """Also where a point cannot be: there the stiffness is nan."""
    preloads = np.array([0.01, 0.3, 1.0])
    p = table_1(**GUIDE, contact_spread=0.1)
    impossible, *plants = Plant.column(p.replace(preload=preloads)).points(3)
    assert np.isnan(impossible.contact.sigma_0)
    for plant, preload in zip(plants, preloads[1:].tolist(), strict=True):
        assert len(plant.contacts) == 6
        assert plant == Plant.of(p.replace(preload=preload))


def test_what_cannot_be_is_refused_with_a_cure() -> None:
    for values, said in [
        ({**GUIDE, "contacts": 4}, "contacts is 4 and contact_shares is guide.*set contacts to 6"),
        ({**GUIDE, "preload": 0.01}, "contact_shares is guide: .* would have to pull"),
        (
            {"contacts": 3, "alpha_form": "printed", "z_ba": 1e-8, "z_ss": 5e-8},
            "contacts is 3 .* alpha_form to dupont",
        ),
        (
            {"contacts": 3, "z_ba": 5e-8, "z_ss": 4e-8},
            "contact 1 of 3, with 0.133 N of the preload",
        ),
        ({"contacts": 17}, "contacts is 17; it has to lie between 1 and 16"),
    ]:
        with pytest.raises(ParameterError, match=said):
            Plant.of(table_1(**values))


LEVEL = math.pi / 2.0
#: m and N of Table 5; alpha as the forces tell it.
MASS, PRELOAD, MU = 3e-3, 0.2, 0.2


def test_table_5() -> None:
    """Every number to its last digit; the ratio of 2.8 is printed from 0.566 / 0.2."""
    forces = forces_by_preload(Geometry(), MASS, LEVEL, PRELOAD)
    assert Geometry().lever == pytest.approx(0.9276)
    assert [round(1e3 * force, 1) for force in astuple(forces)] == [
        74.3, 67.1, 74.3, 67.1, 155.1, 127.8,
    ]  # fmt: skip
    assert round(forces.total, 3) == 0.566
    assert round(preload_ratio(forces, PRELOAD), 1) == 2.8


@pytest.mark.parametrize("alpha", [0.3, 1.0, LEVEL])
def test_the_forces_of_system_2_balance(alpha: float) -> None:
    """Eq. 17, 18, 20 and 27 as printed, and both moments of normal forces."""
    geometry = Geometry(0.02, 0.015, 0.004, 0.006)
    n = forces_by_preload(geometry, MASS, alpha, 0.5)
    load = MASS * GRAVITY * math.sin(alpha)
    assert n.a + n.b + n.c + n.d == pytest.approx(n.e + n.f)
    up, down = (n.a + n.c + n.e) / math.sqrt(2.0), (n.b + n.d + n.f) / math.sqrt(2.0)
    assert up - down == pytest.approx(load)
    assert (n.e - n.f) * geometry.e == pytest.approx(load * (geometry.a - geometry.b) / 2.0)
    assert (n.e + n.f) / math.sqrt(2.0) == pytest.approx(0.5)
    assert (n.a + n.d, n.c + n.d) == pytest.approx((n.b + n.c, n.a + n.b))


def test_the_sum_is_two_root_two_preloads_whatever_the_geometry() -> None:
    """By Eq. 17 and 27: so the ratio to the preload is 2.83, with or without gravity."""
    for geometry in (Geometry(), Geometry(0.02, 0.02, 0.001, 0.01)):
        for alpha in (0.0, LEVEL):
            forces = forces_by_preload(geometry, 1e-3, alpha, 1.0)
            assert preload_ratio(forces, 1.0) == pytest.approx(2.0 * math.sqrt(2.0))


def system_1(
    geometry: Geometry, mass: float, alpha: float, mu: float, acceleration: float = 0.0
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return matrix (6, 6) and right side (6,) of Eq. 24-26, as M (A B C D E F) = R in N.

    mass kg, alpha rad, acceleration along the axis m/s^2. Row 3 of R is that of Eq. 19, of which
    the print leaves the 1/mu only; rows 5 and 6 are divided by a length.
    """
    root = math.sqrt(2.0)
    side, b, a = geometry.c / root, mu * geometry.b, mu * geometry.a  # Eq. 25
    weight = mass * GRAVITY
    matrix = np.array(
        [
            [1.0, 1.0, 1.0, 1.0, -1.0, -1.0],
            [1.0, -1.0, 1.0, -1.0, 1.0, -1.0],
            [1.0, 1.0, 1.0, 1.0, 1.0, 1.0],
            [0.0, 0.0, 0.0, 0.0, 1.0, -1.0],
            [side - b, b - side, -side - b, side + b, -b, b],
            [a - side, a - side, a + side, a + side, -a, -a],
        ]
    )
    matrix[4:] /= side
    right = np.zeros(6)
    right[1] = root * weight * math.sin(alpha)
    right[2] = mass / mu * (acceleration + GRAVITY * math.cos(alpha))
    right[3] = weight * geometry.lever * math.sin(alpha)
    return matrix, right


def test_the_forces_of_system_1_balance() -> None:
    """Eq. 17-22 with every moment of friction; here the acceleration presses, not the preload."""
    geometry = Geometry(0.01, 0.0099, 0.01, 0.01)
    a, b, c = geometry.a, geometry.b, geometry.c
    n = ContactForces.of(*system_1(geometry, MASS, LEVEL, MU, 50.0))
    root = math.sqrt(2.0)
    assert MU * n.total == pytest.approx(MASS * 50.0)  # Eq. 19
    assert (n.e - n.f) * geometry.e == pytest.approx(MASS * GRAVITY * (a - b) / 2.0)
    roll = ((n.a + n.d) - (n.b + n.c)) / root * c / 2.0  # Eq. 21
    roll += (n.f + n.d + n.b - n.a - n.c - n.e) * MU * b / 2.0
    pitch = ((n.c + n.d) - (n.a + n.b)) / root * c / 2.0  # Eq. 22
    pitch += MU * (n.a + n.b + n.c + n.d - n.e - n.f) * a / 2.0
    assert (roll, pitch) == pytest.approx((0.0, 0.0), abs=1e-15)


def test_system_1_has_full_rank_but_cannot_hold_a_resting_level_runner() -> None:
    """Eq. 19 then asks for no friction at all, so for normal forces whose sum is zero."""
    matrix, right = system_1(Geometry(), MASS, LEVEL, MU)
    assert np.linalg.matrix_rank(matrix) == 6
    forces = ContactForces(*np.linalg.solve(matrix, right))
    assert forces.total == pytest.approx(0.0, abs=1e-15)
    with pytest.raises(ParameterError, match=r"B \(-.*would have to pull"):
        ContactForces.of(matrix, right)


def test_contacts_that_fall_together_are_named_by_the_rank() -> None:
    matrix, right = system_2(Geometry(), MASS, LEVEL, PRELOAD)
    matrix[3] = -matrix[4]
    with pytest.raises(ParameterError, match="singular: rank 5 of 6"):
        ContactForces.of(matrix, right)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"preload": 0.01}, r"contact .*F \(-.*raise the preload"),
        ({"preload": -0.2}, "preload of the guide is -0.2 N"),
        ({"mass": 0.0}, "mass of the guide is 0 kg"),
        ({"alpha": math.nan}, "alpha of the guide is nan rad"),
    ],
)
def test_what_cannot_stand_is_refused(values: dict[str, Any], words: str) -> None:
    with pytest.raises(ParameterError, match=words):
        forces_by_preload(
            **{"geometry": Geometry(), "mass": MASS, "alpha": LEVEL, "preload": PRELOAD, **values}
        )


@pytest.mark.parametrize("name", ["a", "b", "c", "e"])
def test_a_length_that_is_none_is_refused(name: str) -> None:
    with pytest.raises(ParameterError, match=f"{name} of the guide is 0 m"):
        Geometry(**{name: 0.0})


def test_the_preload_that_a_refusal_names_is_that_of_the_runner() -> None:
    """It had been that of six times the contact, below the one that was refused."""
    values: dict[str, Any] = {
        "model": "epm_calc",
        "contacts": 6,
        "contact_shares": "guide",
        "preload": 0.41,
    }
    for _ in range(4):  # the shares change with the preload
        try:
            Plant.of(Parameters.of(values))
            break
        except ParameterError as error:
            named = re.search(r"raise preload to ([\d.]+) N", str(error))
            assert named
            assert float(named[1]) > values["preload"]
            values["preload"] = float(named[1])
    Plant.of(Parameters.of(values))
