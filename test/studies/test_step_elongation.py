# SPDX-License-Identifier: Apache-2.0
"""Step elongation by holds around the slip (section 4.2)."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from table_1 import table_1

from stickslip_ros.parameters import ParameterError
from stickslip_ros.studies.step_elongation import elongate_step, elongation_map
from stickslip_ros.traces import run_steps


def test_a_known_hold() -> None:
    """At 10 kHz and 0.4 N: 130.5 nm without, 204 nm with 35 % held before the slip."""
    p = table_1(frequency=1e4, waveform="hold")
    plain, held = 1e9 * elongation_map(p, np.array([0.0, 0.35]), np.zeros(2))
    assert plain == pytest.approx(130.5, abs=0.1)
    assert held == pytest.approx(204.0, abs=1.0)


@pytest.mark.parametrize("waveform", ["sawtooth", "shaped"])
def test_the_step_grows(waveform: str) -> None:
    """By 1.4 times and more; a run with the holds found makes that step."""
    p = table_1(frequency=1e4, waveform=waveform, split=0.9)
    found = elongate_step(p)
    assert found.step_after > 1.4 * found.step_before
    held = {"hold_before": found.hold_before, "hold_after": found.hold_after}
    again = p.replace(waveform="shaped" if waveform == "shaped" else "hold", **held)
    position = run_steps(again, 300).position
    assert (position[-1] - position[-51]) / 50 == pytest.approx(found.step_after, abs=1e-12)


def test_no_hold_where_none_helps() -> None:
    """A runner that no slip can move is not moved by holds either."""
    found = elongate_step(table_1(preload=50.0, frequency=100.0))
    assert found.step_before == pytest.approx(0.0, abs=1e-11)
    assert found.step_after == found.step_before
    assert (found.hold_before, found.hold_after) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"waveform": "table"}, "waveform is table"),
        ({"frequency": 2e5}, "frequency is 200000 Hz"),
        ({"preload": 0.6, "model": "epm_calc", "z_ba": 1e-6}, "z_ss"),
    ],
)
def test_what_has_no_holds(values: dict[str, Any], words: str) -> None:
    with pytest.raises(ParameterError, match=words):
        elongate_step(table_1(**values))
