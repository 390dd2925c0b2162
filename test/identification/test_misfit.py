# SPDX-License-Identifier: Apache-2.0
"""Axes that no parameters explain, from an integrator of their own, and one that they do."""

from __future__ import annotations

import pytest
from bench_traces import Axis, Drive
from experiments import truth_of
from other_axes import Other, other_trace

from stickslip_ros.identification import Fit, identify
from stickslip_ros.parameters import Parameters
from stickslip_ros.traces.motion import Motion

pytestmark = [pytest.mark.usefixtures("compiled_solver"), pytest.mark.slow]

AXIS = Axis(preload=0.6, mass=5e-3, sigma_1=7.0)


def fitted(other: Other, fit_lag: bool = False) -> Fit:
    drive = Drive(12, frequency=400.0, amplitude=280.0, pause=5e-3)
    t, x = other_trace(AXIS, other, drive, 5e5, 1e-9, 3)
    known = {"preload": 0.6, "mass": 5e-3, "frequency": 400.0, "amplitude": 280.0}
    start = {name: 1.5 * value for name, value in truth_of(AXIS).items()}
    return identify([(Parameters.of({**known, **start}), Motion("lab", t, x))], fit_lag=fit_lag)


def test_an_axis_of_the_model_is_no_misfit() -> None:
    found = fitted(Other())
    assert found.misfit is None
    for name, true in truth_of(AXIS).items():
        assert found.parameters[name].value == pytest.approx(true, rel=0.1)


@pytest.mark.parametrize("other", [Other(second=0.15), Other(jump=0.2)])
def test_another_axis_is_told(other: Other) -> None:
    found = fitted(other)
    assert found.misfit is not None
    assert "repeats with the drive" in found.misfit.text
    assert found.as_json()["misfit"].startswith("lab: ")


def test_a_lag_of_the_amplifier_is_named() -> None:
    found = fitted(Other(lag=1.5e-6))
    assert found.misfit is not None
    assert found.misfit.text.endswith(
        "a lag of the amplifier explains it: identify again with --fit-lag"
    )


def test_with_the_lag_free_the_intervals_hold_the_truth() -> None:
    found = fitted(Other(lag=1.5e-6), fit_lag=True)
    assert found.misfit is None
    lag = found.parameters["amplifier_lag"]
    assert lag.unit == "s"
    assert lag.value == pytest.approx(1.5e-6, rel=0.2)
    for name, true in truth_of(AXIS).items():
        one = found.parameters[name]
        assert one.value == pytest.approx(true, rel=0.15), name
    assert found.ensemble is not None
    assert "amplifier_lag" not in found.ensemble.names
