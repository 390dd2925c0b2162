# SPDX-License-Identifier: Apache-2.0
"""The shaped slip: how little ringing it leaves, and that the numbers are those of the runner."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from table_1 import table_1

from stickslip_ros.model import drive_of, plant_of
from stickslip_ros.parameters import ParameterError, Parameters
from stickslip_ros.studies.slip_shaping import ringing, shape_slip, shaping_map
from stickslip_ros.traces import run_steps, trace_steps


def shaped(p: Parameters, split: float, latency: float) -> Parameters:
    return p.replace(waveform="shaped", split=split, latency=latency)


@pytest.mark.parametrize("preload", [0.4, 1.0])
def test_the_ringing_goes(preload: float) -> None:
    """At least twenty times less than after the single slip, in the runner's own trace too."""
    p = table_1(preload=preload)
    found = shape_slip(p)
    assert found.ringing_after < found.ringing_before / 20.0
    best = shaped(p, found.split, found.latency)
    assert found.step_before == pytest.approx(run_steps(p, 12).step_size, abs=1e-11)
    assert found.step_after == pytest.approx(run_steps(best, 12).step_size, abs=1e-11)
    for values, wanted in ((p, found.ringing_before), (best, found.ringing_after)):
        period = drive_of(values).period
        trace = trace_steps(values, 13)
        first = (trace.t >= 12 * period) & (trace.t <= 12 * period + 3 * found.ringing_period)
        assert np.ptp((trace.x - trace.u)[first]) == pytest.approx(wanted, rel=0.01, abs=2e-11)


def test_the_known_start() -> None:
    """85.5 % and 0.48 ringing periods at 0.4 N leave a small part of it."""
    p = table_1()
    latency = 0.48 / plant_of(p).ringing_frequency
    assert ringing(shaped(p, 0.855, latency))[0] < ringing(p)[0] / 20.0


def test_the_map_is_the_ringing_of_each_pair() -> None:
    p = table_1(frequency=1000.0)
    found = shaping_map(p, np.array([0.5, 0.9]), np.array([2e-5, 6e-5, 2e-3]))
    assert found.shape == (2, 3)
    assert found[1, 1] == ringing(shaped(p, 0.9, 6e-5))[0]
    assert np.isnan(found[:, 2]).all()
    assert np.isfinite(found[:, :2]).all()


def test_holds_stay_only_where_they_were_in_force() -> None:
    held = table_1(frequency=1000.0, hold_before=0.2)
    one = np.array([0.8]), np.array([5e-5])
    assert shaping_map(held, *one) == shaping_map(held.replace(hold_before=0.0), *one)
    assert shaping_map(held.replace(waveform="hold"), *one) != shaping_map(held, *one)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"waveform": "triangle"}, "waveform is triangle; the slip of sawtooth"),
        ({"sigma_1": 1e4}, "damped too much to ring"),
        ({"frequency": 9e4}, "ringing period takes 132.473 us, no latency .* lower the frequency"),
        ({"frequency": 2e5}, "frequency is 200000 Hz"),
    ],
)
def test_what_cannot_be_shaped(values: dict[str, Any], words: str) -> None:
    with pytest.raises(ParameterError, match=words):
        shape_slip(table_1(**values))


def test_a_blocked_axis_has_little_to_shape() -> None:
    """At 20 N nothing slips; the search ends with finite numbers."""
    found = shape_slip(table_1(preload=20.0, frequency=1000.0))
    assert found.ringing_after <= found.ringing_before
    assert math.isfinite(found.step_after)
