# SPDX-License-Identifier: Apache-2.0
"""Parameters from traces of an independent integrator."""

import json
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from bench_traces import Axis, Drive, Sensor, bench_trace
from experiments import experiment, holds, small, truth_of

from stickslip_ros.measurement.identification import (
    Experiment,
    Fit,
    IdentificationError,
    Prior,
    identify,
)
from stickslip_ros.physics.parameters import ParameterError, Parameters
from stickslip_ros.simulation.motion import Motion


@pytest.fixture(scope="module")
def found() -> Fit:
    return identify([small()[1]])


def test_every_interval_holds_the_truth_and_is_narrow(found: Fit) -> None:
    for name, true in truth_of(small()[0]).items():
        one = found.parameters[name]
        assert one.determined
        assert holds(one.low, true, one.high), name
        assert one.value == pytest.approx(true, rel=0.1), name
    assert found.complete
    assert found.unknown == ()


def test_what_the_values_rest_on_is_said(found: Fit) -> None:
    """A payload of 20 % moved sigma_0 by as much, which no residual shows; nothing was said."""
    (mass,) = (line for line in found.given if line.startswith("10 % more mass"))
    assert mass.startswith("10 % more mass would not show: sigma_0 +10 %, sigma_1 +10 %")
    assert mass in found.report() and mass in found.as_json()["given"]
    assert any(
        line.startswith("10 % more preload would not show: sigma_0ss") for line in found.given
    )
    assert not any("gain" in line for line in found.given)  # a wrong one is a misfit


def test_the_noise_of_the_sensor_is_told(found: Fit) -> None:
    assert found.noise == pytest.approx(1e-9, rel=0.05)


def test_the_file_of_the_fit_has_the_values(found: Fit) -> None:
    assert found.base.friction.sigma_0 == found.parameters["sigma_0"].value
    assert found.base.friction.preload == 0.5


def test_json_has_everything_and_no_nan(found: Fit) -> None:
    told = json.loads(json.dumps(found.as_json(), allow_nan=False))
    assert set(told) >= {"parameters", "correlations", "noise", "residual", "misfit", "runs"}
    assert told["parameters"]["sigma_0"]["unit"] == "N/m"
    assert told["correlations"]["z_ba"]["z_ba"] == pytest.approx(1.0)
    assert told["runs"][0]["steps"] == 10


def test_the_profile_is_lowest_at_the_value(found: Fit) -> None:
    for one in found.profiles:
        assert one.values[np.argmin(one.rise)] == pytest.approx(found.parameters[one.name].value)


@pytest.mark.long
def test_one_trace_of_twelve_cycles_is_within_the_stated_accuracy() -> None:
    """Of an amplifier that is known to have no lag; with one that is not, the interval allows."""
    axis = Axis()
    drive, sensor = Drive(12, pause=0.01), Sensor(rate=5e5, noise=1e-9)
    found = identify([experiment(axis, drive, sensor, 1, rest=8e-3)], fit_lag=False)
    for name, part in (("sigma_0", 0.01), ("sigma_1", 0.05), ("z_ba", 0.1), ("sigma_0ss", 0.1)):
        one = found.parameters[name]
        assert one.value == pytest.approx(truth_of(axis)[name], rel=part), name
        assert one.determined


@pytest.mark.long
def test_hum_drift_and_a_wrong_clock_do_not_pull_at_the_values() -> None:
    axis = small()[0]
    sensor = Sensor(
        rate=5e5, noise=2e-9, hum=1e-8, drift=2e-7, clock_drift=1e-4, spikes=5, zero=1e-6
    )
    drive = Drive(12, frequency=150.0, amplitude=250.0, pause=8e-3)
    found = identify([experiment(axis, drive, sensor, 5)])
    assert found.runs[0].mains == (50.0,)
    assert found.runs[0].clock_drift == pytest.approx(1e-4, abs=3e-5)
    for name, true in truth_of(axis).items():
        assert found.parameters[name].value == pytest.approx(true, rel=0.1), name


@pytest.mark.long
def test_a_trace_that_begins_and_ends_while_the_axis_steps() -> None:
    axis, (known, whole) = small()
    period = 1.0 / 800.0
    part = whole.between(5e-3 + 3.3 * period, 5e-3 + 9.4 * period)
    found = identify([(known, part)])
    for name, true in truth_of(axis).items():
        assert found.parameters[name].value == pytest.approx(true, rel=0.1), name


@pytest.mark.long
def test_a_gap_in_the_middle_of_a_run_moves_no_interval() -> None:
    """What lay before it was taken for a rest: a lag of 3.3 us was told, in silence."""
    axis, (known, whole) = small()
    kept = (whole.t < 7e-3) | (whole.t > 9e-3)
    found = identify([(known, Motion("gap", whole.t[kept], whole.x[kept]))])
    assert found.misfit is None
    for name, true in truth_of(axis).items():
        one = found.parameters[name]
        assert holds(one.low, true, one.high), name


def test_interrupted_it_gives_the_best_so_far() -> None:
    shown: list[Mapping[str, float]] = []

    def stop(what: str, part: float, best: Mapping[str, float]) -> None:
        shown.append(best)
        if len(shown) == 4:
            raise KeyboardInterrupt

    found = identify([small()[1]], progress=stop)
    assert not found.complete
    assert {name: found.parameters[name].value for name in shown[-1]} == pytest.approx(shown[-1])
    assert all(one.low is None and not one.determined for one in found.parameters.values())
    assert json.dumps(found.as_json(), allow_nan=False)


@pytest.mark.long
def test_what_cannot_be_known_is_said() -> None:
    """Mass, stiffness and damping times a factor move alike."""
    axis, (known, motion) = small()
    scaled = Parameters.of({**known.flat(), **truth_of(axis)})
    found = identify([(scaled, motion)], ["mass", "sigma_0", "sigma_1"])
    (told,) = found.unknown
    for name in ("mass", "sigma_0", "sigma_1"):
        assert name in told
        assert not found.parameters[name].determined
    assert "give the mass" in told


def test_a_prior_determines_what_the_trace_does_not() -> None:
    axis, (known, motion) = small()
    scaled = Parameters.of({**known.flat(), **truth_of(axis)})
    found = identify([(scaled, motion)], ["mass", "sigma_0"], priors={"mass": Prior(5e-3, 2.5e-4)})
    mass = found.parameters["mass"]
    assert mass.low is not None and mass.high is not None
    assert mass.low < 5e-3 < mass.high


@pytest.mark.long
def test_a_measurement_in_which_the_amplitude_changes_is_refused() -> None:
    drive = Drive(8, frequency=400.0, amplitude=280.0, pause=8e-3)
    drives = (drive, replace(drive, direction=-1), replace(drive, amplitude=200.0))
    sensor = Sensor(rate=5e5, noise=1e-9)
    known = Parameters.of({"preload": 0.5, "mass": 5e-3, "frequency": 400.0, "amplitude": 280.0})
    bench = bench_trace(Axis(preload=0.5, mass=5e-3), drives, sensor, 8e-3)
    with pytest.raises(IdentificationError, match="amplitude, preload or load changed between"):
        identify([(known, Motion("two.csv", bench.t, bench.x))])
    same = bench_trace(Axis(preload=0.5, mass=5e-3), (drive, drives[1], drive), sensor, 8e-3)
    found = Experiment.of(known, Motion("same.csv", same.t, same.x))
    assert [run.steps for run in found.runs] == [8, -8, 8]
    assert found.steps == 24


@pytest.mark.long
def test_a_trace_without_steps_is_refused() -> None:
    t = np.arange(0.0, 0.1, 1e-5)
    still = Motion("still.csv", t, 1e-9 * np.random.default_rng(1).standard_normal(len(t)))
    with pytest.raises(IdentificationError, match=r"still.csv shows no steps at 100 Hz"):
        identify([(Parameters.of({"frequency": 100.0}), still)])


def test_bad_use_is_refused() -> None:
    for names, options, words in [
        (["amplitude"], {}, "amplitude cannot be free"),
        (["z_baa"], {}, "did you mean z_ba"),
        (["sigma_0", "sigma_0"], {}, "named twice"),
        (["sigma_0"], {"bounds": {"z_ba": (1.0, 2.0)}}, "z_ba has bounds but is not free"),
        (["sigma_0"], {"bounds": {"sigma_0": (2.0, 1.0)}}, "the lower one first"),
        (["sigma_0_slope"], {}, "no effect where sigma_0 is set"),
        (["sigma_2"], {}, "sigma_2 has no starting value above 0"),
    ]:
        with pytest.raises((IdentificationError, ParameterError), match=words):
            identify([small()[1]], names, **options)  # type: ignore[arg-type]


def test_nothing_measured_is_refused() -> None:
    with pytest.raises(IdentificationError, match="no measurement was given"):
        identify([])
