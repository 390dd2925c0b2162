# SPDX-License-Identifier: Apache-2.0
"""Quantities as people read them."""

import math

from stickslip_ros.reporting import format_si


def test_a_value_has_a_unit_of_fitting_size() -> None:
    for value, unit, text in [
        (133.83e-9, "m", "133.8 nm"),
        (-1e-9, "m", "−1.000 nm"),
        (3e-6, "m", "3000 nm"),
        (2.1e-3, "m", "2.100 mm"),
        (3e-6, "s", "3.000 µs"),
        (2.5266e6, "N/m", "2.527 N/µm"),
        (12.0, "N/m", "12.00 N/m"),
        (3990.0, "Hz", "3990 Hz"),
        (1e-16, "m", "0 nm"),
        (math.nan, "m", "–"),
    ]:
        assert format_si(value, unit) == text


def test_an_uncertainty_sets_the_digits() -> None:
    assert format_si(133.8312e-9, "m", uncertainty=0.052e-9) == "133.831 ± 0.052 nm"
    assert format_si(36.73055e-6, "s", uncertainty=311e-9) == "36.73 ± 0.31 µs"
    assert format_si(-4.0e3, "Hz", uncertainty=120.0) == "−4000 ± 120 Hz"
    assert format_si(1.0, "N", uncertainty=math.nan) == "1.000 N"


def test_the_unit_can_be_that_of_another_value() -> None:
    assert format_si(1e-9, "s", like=1e-6) == "0.001 µs"
