# SPDX-License-Identifier: Apache-2.0
"""Waveforms found by search: the ringing of a shaped slip, the step with holds."""

from typing import Any

import numpy as np
import pytest
from table_1 import table_1

from stickslip_ros.physics.model import Plant, drive_of
from stickslip_ros.physics.parameters import ParameterError, Parameters
from stickslip_ros.simulation.sampling import trace_steps
from stickslip_ros.simulation.steps import run_steps
from stickslip_ros.simulation.waveform_search import (
    elongate_step,
    elongation_map,
    ringing_and_step,
    shape_slip,
    shaping_map,
)


def shaped(p: Parameters, split: float, latency: float) -> Parameters:
    return p.replace(waveform="shaped", split=split, latency=latency)


@pytest.mark.parametrize("preload", [0.4, pytest.param(1.0, marks=pytest.mark.long)])
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
    latency = 0.48 / Plant.of(p).ringing_frequency
    assert ringing_and_step(shaped(p, 0.855, latency))[0] < ringing_and_step(p)[0] / 20.0


def test_the_map_is_the_ringing_of_each_pair() -> None:
    p = table_1(frequency=1000.0)
    found = shaping_map(p, np.array([0.5, 0.9]), np.array([2e-5, 6e-5, 2e-3]))
    assert found.shape == (2, 3)
    assert found[1, 1] == ringing_and_step(shaped(p, 0.9, 6e-5))[0]
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
        ({"frequency": 9e4}, "ringing period takes 132.473 us; no latency .* lower the frequency"),
        ({"frequency": 2e5}, "frequency is 200000 Hz"),
    ],
)
def test_what_cannot_be_shaped(values: dict[str, Any], words: str) -> None:
    with pytest.raises(ParameterError, match=words):
        shape_slip(table_1(**values))


def test_a_blocked_axis_has_nothing_to_shape() -> None:
    """At 20 N nothing slips."""
    with pytest.raises(ParameterError, match=r"preload is 20 N .* no steps"):
        shape_slip(table_1(preload=20.0, frequency=1000.0))


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
    found = elongate_step(table_1(preload=50.0, frequency=100.0, creep=0.02, dwell_growth=0.01))
    assert found.left_out == ("creep",)  # the contact ages
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
