# SPDX-License-Identifier: Apache-2.0
"""What notebooks display of results: well-formed HTML with the numbers, and a line as text."""

import xml.etree.ElementTree as ET
from functools import cache
from typing import Any

import pytest
from table_1 import table_1

import stickslip_ros as ss

pytestmark = pytest.mark.slow


@cache
def heavier() -> ss.Comparison:
    """An axis with more preload, and the sample."""
    return ss.compare(table_1(preload=1.0), "steps_100hz.csv")


@pytest.mark.parametrize(
    ("make", "texts"),
    [
        (lambda: ss.simulate(table_1(preload=0.5), steps=12), ["130.4 nm"]),
        (lambda: ss.sweep(preload=[0.5, 1.0]), ["preload"]),
        (lambda: ss.linearise(preload=0.5), ["A, row 2", "voltage, force", "position, deflection"]),
        (heavier, ["step size", "113.20 nm", "133.77 nm", "differs", "rmse"]),
        (lambda: ss.analyse("steps_100hz.csv"), ["10 at 100 Hz", "133.", "±", "ringing"]),
        (lambda: ss.read_measurement("steps_100hz.csv"), ["14000", "140.0 ms", "nm"]),
    ],
)
def test_a_table_is_displayed(make: Any, texts: list[str]) -> None:
    found = make()
    table = ET.fromstring(found._repr_html_())
    assert table.tag == "table"
    text = " ".join(table.itertext())
    assert [one for one in texts if one not in text] == []
    if not isinstance(found, ss.StateSpace):
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
    drive = ss.Parameters()
    return {
        "motion": ss.read_measurement(measured),
        "run": ss.analyse(measured),
        "comparison": ss.compare({}, measured),
        "fit": ss.identify([(drive, ss.read_measurement(measured))], ["sigma_1"], fit_lag=False),
    }


def test_a_result_is_a_table_of_pandas(results: dict[str, Any]) -> None:
    pytest.importorskip("pandas")
    tables = {name: one.to_frame() for name, one in results.items()}
    motion, run, fit = results["motion"], results["run"], results["fit"]
    assert tables["motion"]["position (m)"].tolist() == motion.x.tolist()
    assert tables["run"]["step (m)"].tolist() == run.step_sizes.tolist()
    assert tables["run"].index.tolist() == list(range(1, 11))
    (row,) = tables["fit"].to_dict("records")
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
