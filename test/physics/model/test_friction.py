# SPDX-License-Identifier: Apache-2.0
"""The friction laws: values of the paper, the form of alpha, loads, what is refused."""

import math
from typing import Any

import numpy as np
import pytest
from table_1 import table_1

from stickslip_ros.physics.laws import LEFT_TO_LAW
from stickslip_ros.physics.model import LAWS, Contact, Plant, alpha_of, friction_force, z_rate
from stickslip_ros.physics.model.friction import constants_in_force, contact_columns
from stickslip_ros.physics.parameters import ParameterError

#: Laws of the form of `Contact`, without a rate of their own
OF_CONTACT = [name for name, law in LAWS.items() if not law.rate]


def contact(**values: Any) -> Contact:
    """Return the contact of a set of parameters."""
    return Plant.of(table_1(**values)).contact


def test_ceim_values() -> None:
    """Section 5.3: f = 1 N gives z_ba = 30 nm and z_ss = 60 nm; Eq. 14 gives 12e6 N/m there."""
    c = contact(preload=1.0)
    assert c.z_ba == pytest.approx(30e-9)
    assert c.z_ss == pytest.approx(60e-9)
    assert c.sigma_0 == pytest.approx(12e6)
    assert c.z_k == c.z_s == pytest.approx(0.2 / 1e7)


def test_stiffness_cap() -> None:
    """With a cap at 2 N the stiffness of Eq. 14 stays at its value for 2 N."""
    assert contact(preload=1.0, sigma_0_cap=2.0).sigma_0 == pytest.approx(12e6)
    assert contact(preload=5.0, sigma_0_cap=2.0).sigma_0 == pytest.approx(17e6)
    assert contact(preload=5.0).sigma_0 == pytest.approx(32e6)


def test_ceim_without_mu_is_ceim() -> None:
    """Section 5.6: mu folded into sigma_0,ss changes nothing."""
    np.testing.assert_allclose(contact(model="ceim_without_mu"), contact(), rtol=1e-15)


@pytest.mark.parametrize("law", OF_CONTACT)
def test_the_preload_ratio_is_a_factor_of_the_normal_force(law: str) -> None:
    """Section 5.2: the law takes the sum of the contact forces, for one point and for columns."""
    guided = contact(model=law, preload=1.0, preload_ratio=2.0)
    assert guided == contact(model=law, preload=2.0)
    assert guided != contact(model=law, preload=1.0)
    p = table_1(model=law, preload_ratio=2.0)
    columns = contact_columns(p.replace(preload=np.array([1.0, 1.5])).friction)
    np.testing.assert_array_equal(columns.z_k, [guided.z_k, contact(model=law, preload=3.0).z_k])


def test_table_2() -> None:
    """LuGre and both elastoplastic laws with the values of Table 2, at f = 1.5 N."""
    assert contact(model="lugre", preload=1.5).z_s == pytest.approx(450e-9)
    calc = contact(model="epm_calc", preload=1.5)
    assert (calc.z_ba, calc.z_s, calc.z_k) == pytest.approx((100e-9, 450e-9, 300e-9))
    fix = contact(model="epm_fix", preload=1.5)
    assert (fix.z_ba, fix.z_ss, fix.z_s, fix.z_k) == pytest.approx((50e-9, 100e-9, 450e-9, 300e-9))


def test_ringing_frequency() -> None:
    """Eq. 11 back and forth: 4 kHz with 4 g is 2.5e6 N/m; Eq. 14 rings at 7.5 kHz instead."""
    slow = Plant.of(table_1(sigma_0=4 * math.pi**2 * 4e-3 * 4e3**2, sigma_1=0.0))
    assert slow.ringing_frequency == pytest.approx(4e3)
    assert Plant.of(table_1()).ringing_frequency == pytest.approx(7.55e3, rel=1e-2)
    assert Plant.of(table_1(sigma_1=1e4)).ringing_frequency == 0.0


def test_gravity_and_payload() -> None:
    """Up the hill gravity pulls back, on the runner and what it carries."""
    plant = Plant.of(table_1(inclination=np.pi / 2, payload=1e-3, force=0.01))
    assert plant.mass == pytest.approx(5e-3)
    assert plant.force == pytest.approx(0.01 - 5e-3 * 9.80665)


def test_a_slack_spring_is_none() -> None:
    """Softer than a real sensor ever is, it would only cost accuracy."""
    assert Plant.of(table_1(spring=3.9e-200)).spring == 0.0
    assert Plant.of(table_1(spring=1e-3)).spring == 1e-3


def test_alpha() -> None:
    """Eq. 7, 16 with Dupont's alpha: 0 up to z_ba, 1/2 half-way, 1 from z_ss, 0 while unloading."""
    c = contact(preload=1.0)
    for sign in (1.0, -1.0):
        assert alpha_of(sign * 29e-9, sign, c) == 0.0
        assert alpha_of(sign * 45e-9, sign, c) == pytest.approx(0.5)
        assert alpha_of(sign * 60e-9, sign, c) == 1.0
        assert alpha_of(sign * 45e-9, -sign, c) == 0.0
        assert alpha_of(sign * 45e-9, 0.0, c) == 0.0


def test_alpha_as_printed() -> None:
    """With z in place of |z| the sine of Eq. 7 is another one where z < 0, unless z_ss = 2 z_ba."""
    values = {"model": "epm_fix", "z_ba": 50e-9, "z_ss": 120e-9}
    dupont, printed = contact(**values), contact(**values, alpha_form="printed")
    mean, width = (120e-9 + 50e-9) / 2, 120e-9 - 50e-9
    for z in (60e-9, 80e-9, 115e-9):
        assert alpha_of(z, 1.0, printed) == alpha_of(z, 1.0, dupont)
        literal = 0.5 * math.sin(math.pi * (-z - mean) / width) + 0.5
        assert alpha_of(-z, -1.0, printed) == pytest.approx(literal, abs=1e-12)
        assert abs(literal - alpha_of(-z, -1.0, dupont)) > 0.1
    assert alpha_of(-49e-9, -1.0, printed) == 0.0
    assert alpha_of(-121e-9, -1.0, printed) == 1.0


@pytest.mark.parametrize("law", ["ceim", "ceim_without_mu", "lugre"])
def test_alpha_as_printed_is_dupont_s_where_z_ss_is_twice_z_ba(law: str) -> None:
    assert contact(model=law, alpha_form="printed") == contact(model=law)


@pytest.mark.parametrize("law", OF_CONTACT)
def test_laws_are_odd_and_bounded(law: str) -> None:
    """F(-z, -w) = -F(z, w), and plastic sliding tends to a finite deflection."""
    c = contact(model=law, preload=1.0)
    for z in (1e-9, 5e-8, 3e-7):
        for w in (1e-5, 1e-2):
            assert friction_force(-z, -w, c) == -friction_force(z, w, c)
            assert z_rate(-z, -w, c) == -z_rate(z, w, c)
    assert z_rate(1e-6, 1e-2, c) < 0.0


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"model": "coulomb"}, "coulomb.*known: ceim"),
        ({"z_ba": 50e-9, "z_ss": 50e-9}, "z_ss is 5e-08 m and z_ba 5e-08 m"),
        ({"z_ba": 50e-9, "z_ss": 40e-9}, "z_ss has to be larger"),
        ({"model": "ceim_ageing", "z_ba": 5e-8, "z_ss": 4e-8}, "z_ss has to be larger"),
        ({"model": "epm_calc", "preload": 0.3}, "raise preload to 0.51 N"),
        ({"model": "epm_calc", "z_ba": 5e-7}, "raise preload to 2.55 N"),
        ({"alpha_form": "other"}, "alpha_form is 'other'"),
        ({"sigma_0_slope": 0.0, "sigma_0_offset": 0.0}, "stiffness of the contact is 0 N/m"),
        ({"sigma_0": 1e-300}, "sigma_0 is 1e-300 N/m; it has to lie between 1 and"),
        ({"sigma_0_slope": 0.0, "sigma_0_offset": 1e-3}, "1 N/m is the lower limit: raise sigma_0"),
    ],
)
def test_refused(values: dict[str, Any], words: str) -> None:
    """What makes no contact is refused with value and cure."""
    with pytest.raises(ParameterError, match=words):
        contact(**values)


@pytest.mark.parametrize("law", LAWS)
def test_the_constants_in_force_are_those_of_the_contact(law: str) -> None:
    """What `--list-parameters` prints for a constant that is not set is what the contact has."""
    p = table_1(model=law, preload=1.0)
    used = constants_in_force(p.friction)
    c = Plant.of(p).contact
    assert used.sigma_0 == c.sigma_0
    for name in ("z_ba", "z_ss"):
        assert getattr(used, name) in (None, getattr(c, name))
    filled = {name: getattr(used, name) for name in LEFT_TO_LAW}
    set_ = {name: value for name, value in filled.items() if value is not None}
    assert Plant.of(p.replace(**set_)).contact == c
