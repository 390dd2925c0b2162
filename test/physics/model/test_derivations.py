# SPDX-License-Identifier: Apache-2.0
"""Constants of the contact from ringing (Eq. 10, 11) and from textbook contact mechanics."""

import math

import pytest
from table_1 import table_1

from stickslip_ros.physics.model import Plant
from stickslip_ros.physics.model.derivations import (
    MATERIALS,
    Elastic,
    contact_radius,
    sigma_0_of_mindlin,
    sigma_0_of_ringing,
    sigma_1_of_decay,
)
from stickslip_ros.physics.parameters import ParameterError

RUBY, STEEL = Elastic(400e9, 0.27), Elastic(215e9, 0.3)


def test_the_ringing_of_table_1() -> None:
    """4 kHz with 4 g: the 2.5e6 N/m of config/table1_vibration.yaml."""
    assert sigma_0_of_ringing(4e3, 4e-3) == pytest.approx(2.526619e6, rel=1e-6)


def test_with_its_decay_the_ringing_gives_back_the_contact() -> None:
    plant = Plant.of(table_1(sigma_1=50.0))
    decay = 50.0 / (2.0 * plant.mass)
    found = sigma_0_of_ringing(plant.ringing_frequency, plant.mass, decay)
    assert found == pytest.approx(plant.contact.sigma_0)
    assert sigma_1_of_decay(decay, plant.mass) == pytest.approx(50.0)


def test_hertz_and_mindlin() -> None:
    """Like spheres on flats: k_t / k_n = 2 (1 - nu) / (2 - nu), for any load (Johnson 1985)."""
    preload, radius, body = 0.4, 1e-3, Elastic(200e9, 0.3)
    a = contact_radius(preload, radius, body, body)
    modulus = body.youngs_modulus / (2.0 * (1.0 - 0.3**2))
    assert a**3 == pytest.approx(0.75 * preload * radius / modulus)
    ratio = sigma_0_of_mindlin(preload, radius, body, body) / (2.0 * modulus * a)
    assert ratio == pytest.approx(2.0 * (1.0 - 0.3) / (2.0 - 0.3))


def test_the_preload_enters_by_its_cubic_root_and_the_modulus_weakly() -> None:
    """Section 4.4.1 about "Breguet 3-36"; against ruby, 70 to 600 kN/mm^2 bring a factor of 2.6."""
    stiff = sigma_0_of_mindlin(0.8, 1e-3, RUBY, STEEL)
    assert stiff / sigma_0_of_mindlin(0.1, 1e-3, RUBY, STEEL) == pytest.approx(2.0)
    moduli = [material.youngs_modulus for material in MATERIALS]
    assert (min(moduli), max(moduli)) == (70e9, 600e9)
    soft, hard = (
        sigma_0_of_mindlin(1.0, 1e-3, RUBY, Elastic(modulus, 0.3))
        for modulus in (min(moduli), max(moduli))
    )
    assert hard / soft == pytest.approx(2.55, abs=0.05)


def test_what_is_no_quantity_is_refused() -> None:
    with pytest.raises(ParameterError, match="frequency is 0; it has to be above 0"):
        sigma_0_of_ringing(0.0, 4e-3)
    with pytest.raises(ParameterError, match="mass is -1"):
        sigma_0_of_ringing(4e3, -1.0)
    with pytest.raises(ParameterError, match="radius is nan"):
        sigma_0_of_mindlin(0.4, math.nan, RUBY, STEEL)
