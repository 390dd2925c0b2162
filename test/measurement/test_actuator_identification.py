# SPDX-License-Identifier: Apache-2.0
"""Actuators identified from loops and whole recordings of models that the package does not have."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from actuator_bench import FULL as TOP
from actuator_bench import STROKE, Bench, bench, bouc_wen, maxwell_slip, preisach
from numpy.typing import NDArray
from table_1 import table_1

from stickslip_ros.measurement.actuator_identification import (
    IdentifiedActuator,
    identify_hysteresis,
)
from stickslip_ros.physics.model.actuator import Actuator
from stickslip_ros.physics.model.actuator_chain import Chain
from stickslip_ros.physics.model.actuator_stages import follow
from stickslip_ros.physics.parameters import ParameterError, Parameters
from stickslip_ros.simulation.steps import run_steps

Numbers = NDArray[np.float64]


def ways(*turns: float, samples: int = 200) -> Numbers:
    """Voltage along straight ways between turns, the last one included."""
    parts = [np.linspace(a, b, samples + 1)[:-1] for a, b in pairwise(turns)]
    return np.append(np.concatenate(parts), turns[-1])


def replay(actuator: Actuator, volts: Numbers) -> Numbers:
    memory, found = actuator.rest(), []
    for volt in volts.tolist():
        memory = memory.moved(volt, actuator.thresholds)
        found.append(actuator.deflection(memory))
    return np.array(found)


NOISE = np.random.default_rng(7).standard_normal(401)
BEFORE, FULL = ways(0, 300, 0)[:-1], ways(0, 300, 0)
MINOR = ways(0, 300, 0, 150, 50, 200, 100, 250, 0)


def test_play_operators_find_themselves() -> None:
    """Minor loops included, to rounding."""
    true = Actuator(3e-10, 150.0 * (np.arange(8) + 0.5) / 8, 1e-11 * np.arange(8.0))
    found = identify_hysteresis(MINOR, replay(true, np.append(BEFORE, MINOR))[len(BEFORE) :], 8)
    assert found.actuator.elastic == pytest.approx(true.elastic)
    np.testing.assert_allclose(found.actuator.weights, true.weights, atol=1e-20)
    assert found.error < 1e-9


def test_what_an_asymmetric_loop_leaves_is_told() -> None:
    """A loop that bends one way cannot be had from play operators: the error says how far off."""
    truth = bouc_wen(np.append(BEFORE, FULL))[len(BEFORE) :]
    bent = truth + 0.3 * truth.max() * (FULL / 300.0) ** 2
    assert identify_hysteresis(FULL, bent, 16).error > 0.02


def test_what_is_no_loop() -> None:
    for volts, deflection, words in [
        (FULL[:20], FULL[:20], "20 samples; 16 play operators take 36"),
        (np.full(99, 5.0), FULL[:99], "the voltage stays at 5 V"),
        (FULL, np.zeros(len(FULL)), "the deflection never changes"),
        (FULL[:300], FULL[:300], "begins at 0 V and ends at .* a loop ends where it began"),
        (NOISE, FULL, "1.* V of noise: no loop is to be seen in it"),
        (FULL, NOISE, "does not follow the voltage"),
        (NOISE, NOISE[::-1], "no loop is to be seen"),
        (1e7 * bouc_wen(FULL), 1e-9 * FULL, "runs ahead of the voltage.*swapped"),
        (FULL, 1e-10 * FULL, "1e-10 m/V, where actuators have .*swapped"),
        (FULL, FULL[:-1], "as many of each: 401, 400"),
        (FULL, np.where(FULL == 150.0, np.nan, FULL), "finite numbers"),
        (FULL, -FULL, "does not rise with the voltage"),
    ]:
        with pytest.raises(ParameterError, match=words):
            identify_hysteresis(volts, deflection, 16)
        with pytest.raises(ParameterError, match="times do not increase"):
            identify_hysteresis(FULL, FULL, 16, np.zeros(len(FULL)))


def test_what_hysteresis_does_to_the_step() -> None:
    """At full voltage next to nothing, at half of it the step shrinks with the stroke."""
    for amplitude, ratio in ((300.0, 1.0005), (150.0, 0.778)):
        p = table_1(amplitude=amplitude)
        linear = run_steps(p, 12).step_size
        looped = run_steps(p.replace(actuator="hysteresis"), 12).step_size
        assert looped / linear == pytest.approx(ratio, abs=0.002)


def found_in(recording: Bench, operators: int = 16) -> IdentifiedActuator:
    return identify_hysteresis(recording.volts, recording.deflection, operators, recording.times)


def off(found: IdentifiedActuator, recording: Bench) -> float:
    """Largest error, level aside, after the first cycles began: share of the true range."""
    actuator, plays, q = found.actuator, np.zeros(len(found.actuator.thresholds)), []
    for volt in recording.volts.tolist():
        plays = np.clip(plays, volt - actuator.thresholds, volt + actuator.thresholds)
        q.append(actuator.elastic * volt + actuator.weights @ plays)
    settled = int(np.argmax(recording.volts > 0.98 * TOP))
    later = settled + int(np.argmax(recording.volts[settled:] < 0.02 * TOP))
    error = (np.array(q) - recording.hysteresis)[later:]
    return float(np.ptp(error) / 2.0 / np.ptp(recording.hysteresis))


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize(
    ("model", "bar"), [(preisach, 0.012), (maxwell_slip, 0.007)], ids=["preisach", "maxwell"]
)
def test_a_recording_as_it_comes_from_the_bench(
    model: Callable[[Numbers], Numbers], bar: float, seed: int
) -> None:
    """Rests, changed amplitudes, creep of 1.5 %, drift of 3 % and noise of 0.1 % of the stroke.

    The hysteresis without all of these is met within 1.2 and 0.7 % of full scale.
    """
    recording = bench(model, seed, creep=0.015, drift=0.03, noise=0.001)
    found = found_in(recording)
    assert off(found, recording) < bar
    assert found.error < 0.015
    assert found.drift is not None
    assert found.drift * recording.times[-1] / STROKE == pytest.approx(0.03, abs=0.02)


@pytest.mark.parametrize("seed", [0, 2, 4, 6])
def test_a_rate_law_with_cycles_of_one_height(seed: int) -> None:
    """Bouc and Wen's loops of one height close, and are met within 1 % of full scale."""
    recording = bench(bouc_wen, seed, drift=-0.02, noise=0.001)
    found = found_in(recording)
    assert off(found, recording) < 0.01
    assert found.width == pytest.approx(0.174, abs=0.01)


@pytest.mark.parametrize("seed", [1, 3, 5, 7])
@pytest.mark.parametrize("noise", [0.0005, 0.002])
def test_creep_is_told_where_the_voltage_rests(seed: int, noise: float) -> None:
    """Within 0.0025 of 0.015 a decade; nothing is seen where there is none."""
    recording = bench(maxwell_slip, seed, creep=0.015, noise=noise)
    assert found_in(recording).creep == pytest.approx(0.015, abs=0.0025)
    assert found_in(bench(maxwell_slip, seed, drift=0.05, noise=noise)).creep is None


def test_the_axis_repeats_the_recording() -> None:
    """The parameters that are found make the deflection of the recording, creep included."""
    recording = bench(maxwell_slip, 7, creep=0.015)
    found = found_in(recording)
    assert found.creep is not None
    thresholds = found.actuator.thresholds
    chain = Chain.of(Parameters.of({"creep": found.creep, "max_voltage": TOP}))._replace(
        elastic=found.actuator.elastic, thresholds=thresholds, weights=found.actuator.weights
    )
    durations, rates = np.diff(recording.times), np.diff(recording.volts) / 0.01
    nodes, spare = np.empty((3, 2**17)), np.empty((3, 2**17))
    count = follow(chain, chain.rest(), durations, rates, nodes, spare)
    assert count > 0
    made = np.interp(recording.times, *nodes[:2, :count])
    apart = (made - recording.deflection)[len(made) // 3 :]
    assert np.ptp(apart) / 2.0 < 0.006 * STROKE


def test_spikes_and_a_long_recording() -> None:
    """300 000 uneven samples with spikes and steps of a converter, in less than 5 s of work."""
    recording = bench(preisach, 3, drift=0.02, noise=0.0005)
    chance = np.random.default_rng(5)
    times = np.sort(chance.uniform(0.0, recording.times[-1], 300_000))
    times += 1e-9 * np.arange(len(times))
    volts = np.interp(times, recording.times, recording.volts)
    deflection = np.interp(times, recording.times, recording.deflection)
    deflection += 0.002 * STROKE * chance.standard_normal(len(times))
    deflection = 5e-9 * np.round(deflection / 5e-9)
    deflection[chance.integers(0, len(times), 30)] += 0.5 * STROKE
    volts[chance.integers(0, len(times), 30)] = 10.0 * TOP
    found = identify_hysteresis(volts, deflection, 16, times)
    assert found.gain == pytest.approx(found_in(recording).gain, rel=0.002)
    assert off(found, recording) < 0.01


def test_an_end_that_was_not_reached_before_plays_no_part() -> None:
    """Samples before both ends of the voltage were met change nothing."""
    recording = bench(preisach, 1)
    start = int(np.argmax(recording.volts > 0.5 * TOP))
    bent = recording.deflection.copy()
    bent[:start] += 0.1 * STROKE
    whole = found_in(recording)
    found = identify_hysteresis(recording.volts, bent, 16, recording.times)
    np.testing.assert_allclose(
        found.actuator.weights, whole.actuator.weights, rtol=1e-6, atol=1e-15
    )
