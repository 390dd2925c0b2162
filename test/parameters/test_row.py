# SPDX-License-Identifier: Apache-2.0
"""Quantities as people type them, with a unit and without."""

import math

import pytest

from stickslip_ros.parameters.row import read_quantity


def test_a_unit_may_be_typed_with_a_prefix_and_a_sign() -> None:
    for text, unit, expected in (
        ("1000", "Hz", 1000.0),
        ("1kHz", "Hz", 1000.0),
        ("-5um", "m", -5e-6),
        ("\u22125 \u00b5m", "m", -5e-6),
        ("100nm", "m", 100e-9),
        ("200V", "V", 200.0),
        ("3 g", "kg", 3e-3),
        ("0.003kg", "kg", 3e-3),
        ("+1.5e-3 N", "N", 1.5e-3),
        ("100 V/us", "V/us", 100.0),
        ("90deg", "rad", math.pi / 2.0),
        ("30deg", "deg", 30.0),
        ("9 N/µm", "N/m", 9e6),
        ("9kN/m", "N/m", 9e3),
        ("5 %", "", 0.05),
        ("-inf", "m", -math.inf),
    ):
        assert read_quantity(text, unit) == expected, text


def test_what_could_mean_something_else_is_refused_with_the_cure() -> None:
    for text, unit, cure in (
        ("1,5um", "m", "write 1.5 with a point"),
        ("20 a", "Hz", "'20 a' is in a; write a number, such as 1.5 Hz"),
        ("1 rad/s", "Hz", "is in rad/s"),
        ("5 M", "m", "is in M"),
        ("5 Nm", "N", "is in Nm"),
        ("um", "m", "'um' is not a number, such as 1.5 m"),
        ("", "", "'' is not a number, such as 1.5"),
        ("1 2", "m", "is in 2"),
    ):
        with pytest.raises(ValueError) as error:
            read_quantity(text, unit)
        assert cure in str(error.value), text
