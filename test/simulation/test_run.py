# SPDX-License-Identifier: Apache-2.0
"""Runs and sweeps of the library, and what notebooks display of results."""

import re
import xml.etree.ElementTree as ET
from functools import cache
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pytest
from table_1 import TABLE_1, table_1

import stickslip_ros as ss
from stickslip_ros.physics.model import Plant
from stickslip_ros.simulation.steps import run_steps

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
    with pytest.raises(ss.StickslipError, match=r"did you mean table1_typical\?"):
        ss.simulate("table1")
    with pytest.raises(ss.ParameterError, match=r"file nosuch; here are .*, mcs_like, "):
        ss.simulate("nosuch")
    with pytest.raises(ss.ParameterError, match="cannot read elsewhere/table1"):
        ss.simulate("elsewhere/table1_typical.yaml")


def test_a_motion_that_is_unstable_by_nature_is_said_to_be() -> None:
    assert "unstable" not in ss.simulate("table1_typical", steps=4).report()
    assert ss.simulate("table1_typical", steps=4).growth < 2.0
    run = ss.simulate(
        model="ceim_without_mu", preload=0.1848627, mu=0.0234419, sigma_0_cap=0.0137587,
        sigma_1=20.62506, mass=2.178304e-4, payload=0.01742524, inclination=0.8916434,
        slewrate=0.0049835, amplitude=3.230308e-5, frequency=34.1084, waveform="triangle", steps=4,
    )  # fmt: skip
    assert run.growth > 100.0
    assert "one of many runs that begin alike" in run.report()


@pytest.mark.parametrize(
    "effects", [{"creep": 0.01}, {"actuator": "hysteresis", "actuator_memory": True}]
)
def test_friction_work_is_the_same_at_any_rate(effects: dict[str, Any]) -> None:
    """Where no sample lay at the end of the cycles, 1 to 44 % was missing behind these effects."""
    run = ss.simulate("table1_typical", steps=20, **effects)
    for rate in (5270.0, 5000.0):
        assert run.trace_at(rate).work[-1] == pytest.approx(run.trace.work[-1], rel=1e-9)


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


@cache
def heavier() -> ss.Comparison:
    """An axis with more preload, and the sample."""
    return ss.compare(table_1(preload=1.0), "steps_100hz.csv")


@pytest.mark.parametrize(
    ("make", "texts"),
    [
        (lambda: ss.simulate(table_1(preload=0.5), steps=12), ["130.4 nm"]),
        (lambda: ss.sweep(preload=[0.5, 1.0]), ["preload"]),
        (heavier, ["step size", "113.20 nm", "133.68 nm", "differs", "rmse"]),
        (lambda: ss.analyse("steps_100hz.csv"), ["cycles", "133.", "standard error", "ringing"]),
        (lambda: ss.read_measurement("steps_100hz.csv"), ["14000", "140.0 ms", "nm"]),
    ],
)
def test_a_table_is_displayed(make: Any, texts: list[str]) -> None:
    found = make()
    table = ET.fromstring(found._repr_html_())
    assert table.tag == "table"
    text = " ".join(table.itertext())
    assert [one for one in texts if one not in text] == []
    assert len(found.report().splitlines()) >= 2


def test_a_comparison_is_one_line_of_text() -> None:
    """Without the arrays, which a dataclass would print by the page."""
    text = repr(heavier())
    assert text.startswith("Comparison(simulation and steps_100hz.csv: rmse ")
    assert "step size" in text
    assert len(text) < 250


@pytest.fixture(scope="module")
def results() -> dict[str, Any]:
    """One of each result of a measurement, the fit of a single parameter."""
    measured = "steps_100hz.csv"
    drive = table_1()
    return {
        "motion": ss.read_measurement(measured),
        "run": ss.analyse(measured),
        "comparison": ss.compare({}, measured),
        "fit": ss.identify([(drive, ss.read_measurement(measured))], ["sigma_1"], fit_lag=False),
    }


@pytest.mark.long
def test_a_result_is_a_table_of_pandas(results: dict[str, Any]) -> None:
    pytest.importorskip("pandas")
    tables = {name: one.to_frame() for name, one in results.items()}
    motion, run, fit = results["motion"], results["run"], results["fit"]
    assert tables["motion"]["position (m)"].tolist() == motion.x.tolist()
    assert tables["run"]["step (m)"].tolist() == run.step_sizes.tolist()
    assert tables["run"].index.tolist() == list(range(1, 11))
    (row,) = (one for one in tables["fit"].to_dict("records") if one["name"] == "sigma_1")
    found = fit.parameters["sigma_1"]
    assert (row["name"], row["value"], row["low"], row["high"]) == (
        "sigma_1", found.value, found.low, found.high,
    )  # fmt: skip
    assert "step size" in tables["comparison"]["name"].tolist()


def test_a_result_draws_its_own_numbers_into_given_axes(results: dict[str, Any]) -> None:
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("agg")
    from matplotlib import pyplot

    drawn = {
        "motion": results["motion"].x,
        "run": results["run"].step_sizes,
        "comparison": results["comparison"].measured,
        "fit": results["fit"].runs[0].measured,
    }
    for name, values in drawn.items():
        figure, axes = pyplot.subplots()
        assert results[name].plot(axes) is axes
        assert (axes.lines[0].get_ydata() == 1e9 * values).all(), name
        assert "(nm)" in axes.get_ylabel()
        pyplot.close(figure)


def test_a_fit_is_displayed_and_reported_as_its_command_prints_it(results: dict[str, Any]) -> None:
    fit = results["fit"]
    found = fit.parameters["sigma_1"]
    text = " ".join(ET.fromstring(fit._repr_html_()).itertext())
    assert "sigma_1" in text
    assert found.name in fit.report()
    assert "steps_100hz.csv: 10 steps" in fit.report()
    assert results["run"].report().startswith("cycles")
    assert "clock offset" in results["comparison"].report()


def test_a_result_is_one_line_of_text(results: dict[str, Any]) -> None:
    """Without the arrays, which a dataclass would print by the page."""
    run = ss.simulate(table_1(), steps=3)
    others = run, run.result, run.trace
    loop = ss.identify_actuator("actuator_loop.csv")
    for one in (*results.values(), *others, loop):
        text = repr(one)
        assert re.fullmatch(rf"{type(one).__name__}\(.*\d.*\)", text), text
        assert "array" not in text
        assert len(text) < 250


@pytest.mark.parametrize(("steps", "said"), [(1, True), (2, True), (3, False)])
def test_a_report_says_what_is_not_so_yet(steps: int, said: bool) -> None:
    """The runner falls back after the last slip; the 0-amplitude is that of settled steps."""
    text = ss.simulate(table_1(), steps=steps).report()
    assert re.search(r"position .* nm, as the last slip ends\n", text)
    assert (", once the steps have settled\n" in text) == said


matplotlib.use("agg")


def test_every_point_is_as_it_is_alone() -> None:
    preloads, masses = [1.0, 0.4], np.array([0.003, 0.004, 0.01])
    found = ss.sweep(preload=preloads, mass=masses, metric=["step_size", "backstep"])
    for i, preload in enumerate(preloads):
        for j, mass in enumerate(masses):
            alone = ss.simulate(preload=preload, mass=float(mass), steps=12)
            assert found["step_size"][i, j] == alone.step_size
            assert found["backstep"][i, j] == alone.backstep
    table = found.to_frame()
    assert table["preload (N)"].tolist() == [1.0] * 3 + [0.4] * 3
    assert table["step_size (m)"].tolist() == found["step_size"].ravel().tolist()


def test_an_impossible_point_is_nan() -> None:
    found = ss.sweep(model="epm_calc", z_ba=1e-7, preload=[0.2, 1.0])
    assert np.isnan(found["step_size"]).tolist() == [True, False]


def test_what_cannot_be_swept_is_refused() -> None:
    for given, complaint in [
        ({}, "nothing varies"),
        ({"preload": []}, "preload has no values"),
        ({"preload": [0.5], "metric": "stepsize"}, "did you mean step_size"),
        ({"model": ["ceim", "lugree"]}, "lugree"),
    ]:
        with pytest.raises((ss.SweepError, ValueError), match=complaint):
            ss.sweep(**given)  # type: ignore[arg-type]


def test_a_map_is_drawn_over_two_parameters() -> None:
    axes = ss.sweep(preload=[0.5, 1.0], mass=[0.003, 0.004]).plot()
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("mass (g)", "preload (N)")
