# SPDX-License-Identifier: Apache-2.0
"""What several contacts are made of: shares of the preload, constants, what is refused."""

from typing import Any

import numpy as np
import pytest
from table_1 import table_1

from stickslip_ros.model import Plant
from stickslip_ros.model.contacts import shares_of
from stickslip_ros.model.plant import scale_distances
from stickslip_ros.parameters import ParameterError

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
