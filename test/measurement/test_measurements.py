# SPDX-License-Identifier: Apache-2.0
"""The library on the sample measurements, which an integrator of its own made."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from bench_traces import Axis, Drive, Sensor, bench_trace
from table_1 import table_1

import stickslip_ros as ss
from stickslip_ros.cli.analyse import analysis_text
from stickslip_ros.measurement.motion_pair import Fits


@cache
def typical() -> ss.Comparison:
    """The typical axis and the sample of it."""
    return ss.compare(table_1(), "steps_100hz.csv")


def test_analyse_finds_what_the_integrator_did() -> None:
    truth = bench_trace(Axis(), (Drive(10, pause=0.02),), Sensor(rate=50e3), rest=0.02).runs[0]
    found = ss.analyse("steps_100hz.csv")
    assert found.step_size == pytest.approx(truth.step_size, abs=0.5e-9)


def test_there_and_back_are_two_runs() -> None:
    runs = ss.find_runs("there_and_back.csv")
    assert [(run.direction, run.steps) for run in runs] == [(1, 8), (-1, 8)]
    assert f"of the 8 steps from {runs[1].span}:" in analysis_text(runs, runs[1])
    assert "of the 8 steps" not in analysis_text(runs[1:], runs[1])


def test_runs_of_a_standing_axis_are_none_and_no_frequency_is_taken_for_one() -> None:
    """A frequency of 0 ended with a ZeroDivisionError, a negative one found nothing."""
    t = np.linspace(0.0, 1.0, 1000)
    still = ss.Motion("still", t, np.random.default_rng(1).normal(0.0, 1e-9, len(t)))
    assert ss.find_runs(still) == []
    with pytest.raises(ss.TraceError, match=r"no whole cycle at 0\.1 Hz"):
        ss.find_runs(still, frequency=0.1)
    for frequency in (0.0, -5.0, np.nan):
        for function in (ss.find_runs, ss.analyse):
            with pytest.raises(ss.TraceError, match="Hz; it has to be above 0"):
                function(still, frequency=frequency)


def test_a_wrong_preload_differs() -> None:
    assert typical().differing == []
    assert "step size" in ss.compare(table_1(preload=1.0), "steps_100hz.csv").differing


def test_the_clock_is_found_in_the_right_swing_of_the_ringing() -> None:
    """It was one swing off, 132 us, where 100 us lay between the places that were looked at."""
    found = typical()
    assert found.alignment.offset == pytest.approx(0.02, abs=1e-6)
    assert found.rmse == pytest.approx(2e-9, rel=0.05)  # the noise of the sensor


@pytest.mark.long
def test_a_standing_axis_has_nothing_to_compare(tmp_path: Path) -> None:
    """It ended with an IndexError."""
    t = np.arange(0.0, 0.1, 1e-5)
    x = np.random.default_rng(0).normal(0.0, 1e-9, len(t))
    path = tmp_path / "still.csv"
    np.savetxt(path, np.c_[t, x], delimiter=",", header="time (s),x (m)", comments="")
    with pytest.raises(ss.MeasurementError, match=r"no steps are found in still\.csv"):
        ss.compare({"preload": 0.4}, path)


@pytest.mark.long
def test_steps_that_only_the_actuator_shows_are_simulated() -> None:
    """The command compared them, the library found none; and it simulated no rest before them."""
    t = np.arange(-0.01, 0.1, 2e-5)
    x = np.random.default_rng(0).normal(0.0, 2e-9, len(t))
    run = ss.simulate(preload=0.4, steps=8).trace
    blocked = ss.Motion("blocked", t, x, None, np.interp(t, run.t, run.u))
    found = ss.compare({"preload": 0.4}, blocked, fits=Fits(offset=False))
    assert found.main.run is not None
    assert (found.main.run.steps, [one.steps for one in found.runs]) == (8, [8])
    assert "step size" in found.differing
    assert found.run.t[0] < blocked.t[0]
    assert found.run.t[-1] > blocked.t[-1]


def test_an_unknown_option_is_refused() -> None:
    for function in (ss.read_measurement, ss.identify_actuator):
        with pytest.raises(ss.MeasurementError, match="no option 'column'; known: columns"):
            function("steps_100hz.csv", column="1")
    with pytest.raises(ss.MeasurementError, match="rate: options of files"):
        ss.identify_actuator(([0.0, 1.0, 0.0], [0.0, 1.0, 0.0]), rate=10.0)


def test_what_is_no_measurement_or_no_run_is_told_what_was_expected() -> None:
    """A Dataset had "no parameter 'x'", and a Motion that was to be read was "no measurement"."""
    motion = ss.read_measurement("steps_100hz.csv")
    run = ss.simulate(steps=2)
    for one in (motion, run, run.trace):
        with pytest.raises(ss.MeasurementError, match="is a motion already; expected is a file"):
            ss.read_measurement(one)
    xarray = pytest.importorskip("xarray")
    data = xarray.Dataset({"x": ("t", motion.x, {"units": "m"})}, {"t": motion.t})
    with pytest.raises(ss.MeasurementError, match="a Dataset is no run; expected is a Motion"):
        ss.compare(data, "steps_100hz.csv")
    with pytest.raises(ss.MeasurementError, match="compare takes parameters first"):
        ss.compare("steps_100hz.csv", {"preload": 0.4})


def test_the_drive_that_is_known_is_an_argument() -> None:
    for frequency, steps in ((100.0, 10), ([100], [10])):
        (run,) = ss.find_runs("steps_100hz.csv", frequency, steps)
        found = ss.analyse("steps_100hz.csv", frequency=frequency, steps=steps)
        both = ss.compare(table_1(), "steps_100hz.csv", frequency=frequency, steps=steps)
        assert run.steps == found.steps == both.runs[0].steps == 10
    with pytest.raises(ss.TraceError, match="2 frequencies and 3 numbers of steps"):
        ss.find_runs("there_and_back.csv", [100.0, 100.0], [8, -8, 8])


def test_an_option_that_a_message_asks_for_is_an_argument_as_it_stands(tmp_path: Path) -> None:
    (tmp_path / "run.csv").write_text("position\n" + "\n".join(map(str, range(40))))
    found = ss.read_measurement(tmp_path / "run.csv", units="x=nm", rate="10kHz", rows="21:")
    assert (found.x[0], found.t[-1]) == pytest.approx((20e-9, 3.9e-3))
    for name, wrong in {"units": "nm", "rate": "10 nm", "rows": "5", "scale": "x"}.items():
        with pytest.raises(ss.MeasurementError, match=f"{name}: '{wrong}' is "):
            ss.read_measurement("steps_100hz.csv", **{name: wrong})
    with pytest.raises(ss.MeasurementError, match=r"units: 'nm' is not of the form t=\.\.\.,x="):
        ss.read_measurement("steps_100hz.csv", units=["nm"])
    with pytest.raises(ss.MeasurementError, match="there is no measurement run"):
        ss.read_measurement("run")


def test_a_misspelt_sample_is_answered_with_the_right_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ss.StickslipError, match=r"did you mean steps_100hz\.csv"):
        ss.read_measurement("step_100hz.csv")


def test_arrays_of_a_loop_do_as_well_as_its_file() -> None:
    volts = np.concatenate([np.linspace(0.0, 100.0, 200), np.linspace(100.0, 0.0, 200)])
    found = ss.identify_actuator((volts, 1e-9 * volts), operators=4)
    assert found.gain == pytest.approx(1e-9)
    assert found.width == pytest.approx(0.0, abs=1e-6)


def test_an_overdamped_contact_is_compared() -> None:
    """It does not ring, so its rests are drawn without swings."""
    found = ss.compare({"sigma_1": 2000.0}, "steps_100hz.csv")
    assert found.rmse > 5.0 * found.noise
