# SPDX-License-Identifier: Apache-2.0
"""What notebooks display of results: well-formed HTML with the numbers, and a line as text."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from typing import Any

import pytest

import stickslip_ros as ss

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("compiled_solver")]


@pytest.mark.parametrize(
    ("make", "texts"),
    [
        (lambda: ss.simulate(preload=0.5, steps=12), ["130.4 nm"]),
        (lambda: ss.sweep(preload=[0.5, 1.0]), ["preload"]),
        (lambda: ss.linearise(preload=0.5), ["A, row 2", "voltage, force", "position, deflection"]),
        (
            lambda: ss.compare({"preload": 1.0}, "steps_100hz.csv"),
            ["step size", "113.20 nm", "133.79 nm", "differs", "rmse"],
        ),
    ],
)
def test_a_table_is_displayed(make: Any, texts: list[str]) -> None:
    found = make()
    table = ET.fromstring(found._repr_html_())
    assert table.tag == "table"
    text = " ".join(table.itertext())
    assert [one for one in texts if one not in text] == []


def test_a_comparison_is_one_line_of_text() -> None:
    """Without the arrays, which a dataclass would print by the page."""
    text = repr(ss.compare({"preload": 1.0}, "steps_100hz.csv"))
    assert text.startswith("Comparison(simulation and steps_100hz.csv: rmse ")
    assert "step size" in text
    assert len(text) < 250
