# SPDX-License-Identifier: Apache-2.0
"""z_ba and the 0-amplitude: how they relate in the model, and the way back."""

from __future__ import annotations

from typing import Any

import pytest
from table_1 import table_1

from stickslip_ros.library.zero_amplitude import z_ba_from_zero_amplitude, zero_amplitude
from stickslip_ros.model import Plant
from stickslip_ros.parameters import ParameterError


@pytest.mark.parametrize("preload", [0.1, 0.4, 1.0, 2.0, 3.0])
def test_the_zero_amplitude_is_a_seventh_above_z_ba(preload: float) -> None:
    """Where ringing dies between slips and z_ss = 2 z_ba: 1.14 z_ba within 3 %, for the CEIM."""
    p = table_1(preload=preload)
    zero = zero_amplitude(p)
    assert zero is not None
    assert zero / Plant.of(p).contact.z_ba == pytest.approx(1.14, rel=0.03)


@pytest.mark.parametrize(
    "values",
    [{}, {"preload": 2.0}, {"model": "epm_fix"}, {"model": "epm_calc", "preload": 0.8}],
    ids=str,
)
def test_z_ba_comes_back_from_the_zero_amplitude(values: dict[str, Any]) -> None:
    p = table_1(**values)
    zero = zero_amplitude(p)
    assert zero is not None
    true = Plant.of(p).contact.z_ba
    assert z_ba_from_zero_amplitude(p, zero) == pytest.approx(true, rel=1e-3)


@pytest.mark.parametrize(
    ("values", "measured", "words"),
    [
        ({"model": "lugre"}, 2e-8, "lugre has no breakaway distance"),
        ({"model": "epm_fix"}, 2e-7, "no z_ba gives a 0-amplitude of 2e-07 m"),
        ({}, 0.0, "the 0-amplitude is 0 m"),
    ],
)
def test_what_gives_no_z_ba_is_refused(values: dict[str, Any], measured: float, words: str) -> None:
    with pytest.raises(ParameterError, match=words):
        z_ba_from_zero_amplitude(table_1(**values), measured)
