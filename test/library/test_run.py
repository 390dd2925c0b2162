# SPDX-License-Identifier: Apache-2.0
"""Runs of the library: the same numbers as the solver's own, in every form they are shown."""

from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pytest
from table_1 import TABLE_1

import stickslip_ros as ss
from stickslip_ros.model import Plant
from stickslip_ros.traces import run_steps

matplotlib.use("agg")


def test_a_run_is_that_of_run_steps() -> None:
    found, plain = ss.simulate(preload=1.0, steps=-9), run_steps({"preload": 1.0}, -9)
    np.testing.assert_array_equal(found.position, plain.position)
    np.testing.assert_allclose(found.steps.sum(), plain.position[-1], rtol=1e-12)
    assert (found.step_size, found.backstep) == (plain.step_size, plain.backstep)


@pytest.mark.parametrize(
    "source", ["table1_typical", "table1_typical.yaml", "config/table1_typical.yaml"]
)
def test_a_parameter_file_of_the_package_is_found_by_its_name(
    source: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert ss.simulate(source, steps=1, mass=0.003).parameters.runner.mass == 0.003


def test_a_misspelt_parameter_file_is_answered_with_the_right_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ss.StickslipError, match=r"did you mean table1_typical\.yaml"):
        ss.simulate("table1_tipical.yaml")
    with pytest.raises(ss.ParameterError, match="cannot read elsewhere/table1"):
        ss.simulate("elsewhere/table1_typical.yaml")


@pytest.mark.parametrize("steps", [0, 10**8, 2.5])
def test_an_impossible_number_of_steps_is_refused(steps: Any) -> None:
    with pytest.raises(ss.ParameterError, match=f"^steps is {steps}"):
        ss.simulate(steps=steps)


def test_the_table_adds_up() -> None:
    table = ss.simulate(steps=12, frequency=200.0).to_frame()
    np.testing.assert_allclose(table["step (m)"].cumsum(), table["position (m)"], rtol=1e-12)
    assert table["time (s)"].iloc[-1] == pytest.approx(0.06)


def test_a_notebook_is_shown_a_table_with_escaped_text() -> None:
    text = ss.simulate(TABLE_1, steps=9)._repr_html_()
    assert "133.8 nm" in text
    assert "<caption>9 steps, ceim, preload 0.4 N</caption>" in text


def test_the_plot_shows_the_trace() -> None:
    found = ss.simulate(steps=3)
    actuator, runner = found.plot().get_lines()
    assert np.max(np.asarray(runner.get_ydata())) == pytest.approx(1e9 * found.trace.x.max())
    assert np.max(np.asarray(actuator.get_ydata())) == pytest.approx(160.0)


@pytest.mark.parametrize("steps", [3, -3])
def test_each_contact_has_its_deflection_of_which_the_trace_shows_the_mean(steps: int) -> None:
    values = {"frequency": 1e3, "contacts": 6, "contact_shares": "guide", "contact_spread": 0.1}
    run = ss.simulate(TABLE_1, **values, steps=steps)
    sigma_0 = np.array([c.sigma_0 for c in Plant.of(run.parameters).contacts])
    mean = sigma_0 @ run.deflections / sigma_0.sum()
    np.testing.assert_allclose(mean, run.trace.z, atol=1e-20)
    assert np.ptp(run.deflections, axis=0).max() > 5e-9
    one = ss.simulate(TABLE_1, steps=steps)
    np.testing.assert_array_equal(one.deflections, one.trace.z[np.newaxis])


def test_a_runner_that_still_rises_when_the_slip_begins_falls_as_far_as_in_its_trace() -> None:
    """It turns away and back within one tabulated arc, which hid both turns."""
    run = ss.simulate(preload=0.4, mass=4e-3, frequency=2000.0, steps=12)
    trace = run.trace_at(2e7)
    begin = 11 / 2000.0 - 3e-6  # 300 V at 100 V/us
    seen = (trace.t > begin - 1e-9) & (trace.t < begin + 1e-4)
    assert trace.x[seen].argmax() > 10
    assert run.backstep == pytest.approx(trace.x[seen][0] - trace.x[seen].min(), abs=2e-12)
