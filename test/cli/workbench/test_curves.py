# SPDX-License-Identifier: Apache-2.0
"""What the page shows: an independent integrator's numbers, the sample measurement, recipes."""

import json
import shlex
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from table_1 import OVER_PRELOAD, TABLE_1

import stickslip_ros as ss
from stickslip_ros.cli.main import main
from stickslip_ros.cli.workbench.controls import (
    CHOICES,
    SLIDERS,
    read_changes,
    recipes,
    set_names,
    shown_values,
)
from stickslip_ros.cli.workbench.curves import Overlay, curves, settled_step
from stickslip_ros.measurement.steps.record import TraceError
from stickslip_ros.physics.parameters import PARAMETERS, ParameterError, Parameters
from stickslip_ros.simulation.motion import Motion

P = Parameters.of(TABLE_1)
SAMPLE = "steps_100hz.csv"


@pytest.fixture(scope="module")
def overlay() -> Overlay:
    return Overlay.of(ss.read_measurement(SAMPLE))


@pytest.mark.parametrize(("preload", "step"), [(0.4, 133.83), (1.0, 113.20), (2.0, 78.91)])
def test_steps_are_those_of_an_independent_integrator(preload: float, step: float) -> None:
    """Fixed-step Runge-Kutta, 1e-7 s in the stick and 1e-9 s in the slip."""
    found = curves(P.replace(preload=preload))
    for curve in found["over"].values():
        assert curve["now"][1] == pytest.approx(step, abs=0.01)
    line = dict(zip(found["step"]["t"], found["step"]["x"], strict=True))
    (slip,) = (point for point in found["step"]["points"] if point["name"] == "C")
    assert (found["step"]["unit"], slip["t"]) == ("ms", pytest.approx(9.997, abs=1e-6))
    assert line[0.0] == 0.0
    cycle, _ = settled_step(P.replace(preload=preload), 1)
    gone = float(np.interp(0.02, cycle.t, cycle.x)) - float(np.interp(0.01, cycle.t, cycle.x))
    # One step; the numbers are means of five, which differ by some hundredths.
    assert 1e9 * gone == pytest.approx(step, abs=0.05)


def test_a_curve_over_the_preload_is_that_of_the_same_integrator() -> None:
    curve = curves(P)["over"]["preload"]
    for preload, step in OVER_PRELOAD.items():
        assert np.interp(preload, curve["x"], curve["y"]) == pytest.approx(step, abs=1.0)


def test_every_answer_is_json_without_nan(overlay: Overlay) -> None:
    cases: list[dict[str, Any]] = [
        {},
        {"model": "lugre"},
        {"preload": 9.0},
        {"frequency": 20e3},
        {"waveform": "triangle"},
        {"waveform": "hold", "hold_before": 0.3},
    ]
    for changes in cases:
        found = curves(P.replace(**changes), overlay)
        assert json.loads(json.dumps(found, allow_nan=False)) == found
        assert set(found["values"]) == {*SLIDERS, *CHOICES}


def test_phases_follow_each_other_and_a_step_backward_mirrors_one_forward() -> None:
    forward, backward = (settled_step(P, sign) for sign in (1, -1))
    assert np.allclose(forward[0].x, -backward[0].x, atol=1e-13)
    phases = curves(P)["step"]["phases"]
    assert all(one["to"] <= after["from"] for one, after in pairwise(phases))
    assert [point["name"] for point in curves(P)["slip"]["points"]] == ["C", "D", "E", "F"]


def test_the_sample_measurement_lies_on_the_step_that_made_it(overlay: Overlay) -> None:
    """Made by an integrator that shares no code, with 2 nm of noise."""
    assert (overlay.steps, overlay.direction) == (10, 1)
    assert overlay.frequency == pytest.approx(100.0, rel=1e-4)
    trace, _ = settled_step(P, 1)
    at, x = overlay.laid_over(trace.t, trace.x, (0.0, 0.0125))
    rest = x - np.interp(at, trace.t, trace.x)
    away = np.abs(at - 0.01) > 2e-5  # the slip itself is shorter than a sample
    assert np.std(rest[away]) < 2e-9
    assert abs(np.mean(rest[away])) < 1e-10
    found = curves(P, overlay)
    assert found["numbers"]["step measured"].startswith("133.")
    assert found["slip"]["measured"]["t"]


def test_a_measurement_without_steps_is_refused() -> None:
    t = np.linspace(0.0, 1.0, 1000)
    with pytest.raises(TraceError, match="no steps are found in rest"):
        Overlay.of(Motion("rest", t, np.zeros_like(t)))


def test_what_the_page_sends_is_checked() -> None:
    assert read_changes({"preload": "0.5", "sigma_0": "", "model": "lugre"}) == {
        "preload": 0.5, "sigma_0": 0.0, "model": "lugre",
    }  # fmt: skip
    for texts, complaint in (
        ({"data_directory": "/"}, "no control 'data_directory'"),
        ({"waveform_table": "/etc/passwd"}, "no control 'waveform_table'"),
        ({"preload": "much"}, "has to be a number"),
    ):
        with pytest.raises(ParameterError, match=complaint):
            read_changes(texts)


def test_controls_stand_in_their_own_units() -> None:
    values = shown_values(P)
    assert (values["mass"], values["z_ba"], values["sigma_0"]) == (4.0, 18.0, 9.0)
    assert set_names(P) == []
    assert set_names(P.replace(z_ba=2e-8)) == ["z_ba"]
    assert shown_values(P.replace(z_ba=2e-8))["z_ba"] == 20.0
    for slider in SLIDERS.values():
        row = PARAMETERS[slider.name]
        for end in (slider.low, slider.high):
            assert row.low <= end * slider.factor * (1 - 1e-12) <= row.high, slider.name


def test_what_is_copied_makes_the_same_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    p = P.replace(preload=1.0, z_ba=2e-8, waveform="hold", hold_before=0.1)
    size = ss.simulate(p, steps=30).step_size
    texts = recipes(p)
    (tmp_path / "drive.yaml").write_text(texts["YAML"], encoding="utf-8")
    assert ss.simulate(tmp_path / "drive.yaml").step_size == size
    names: dict[str, ss.SimulatedRun] = {}
    exec(texts["Python"], names)
    assert names["run"].step_size == size
    capsys.readouterr()
    assert main([*shlex.split(texts["Command"])[1:], "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["step_size"] == size
