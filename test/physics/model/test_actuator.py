# SPDX-License-Identifier: Apache-2.0
"""The actuator: linear to the last bit, hysteresis by play operators, what it bears."""

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from table_1 import table_1

from stickslip_ros.physics.model import DriveCycle, drive_of
from stickslip_ros.physics.model.actuator import (
    Actuator,
    Memory,
    check_voltage,
    hysteresis_text,
    strokes,
)
from stickslip_ros.physics.parameters import ParameterError, Parameters

STROKE = 160e-9


def hysteretic(**values: Any) -> Parameters:
    return table_1(**{"actuator": "hysteresis", **values})


def loop(actuator: Actuator, *turns: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Voltage and deflection along straight ways between turns, sampled, from rest."""
    volts = np.concatenate([np.linspace(a, b, 301)[:-1] for a, b in pairwise(turns)])
    memory = actuator.rest()
    found = []
    for volt in volts.tolist():
        memory = memory.moved(volt, actuator.thresholds)
        found.append(actuator.deflection(memory))
    return volts, np.array(found)


def deflections(drive_cycle: DriveCycle, t: NDArray[np.float64]) -> NDArray[np.float64]:
    """Deflection of a drive cycle at times (s), from 0 at its start."""
    ends = np.append(0.0, np.cumsum(drive_cycle.durations))
    return np.interp(t, ends, np.append(0.0, np.cumsum(drive_cycle.durations * drive_cycle.rates)))


@pytest.mark.parametrize("width", [0.0, 0.15, 0.4])
@pytest.mark.parametrize("full", [300.0, 150.0])
def test_the_full_loop_has_the_stroke_and_the_width_asked_for(width: float, full: float) -> None:
    """``gain * max_voltage`` from end to end; both branches apart by the width at the middle."""
    p = hysteretic(hysteresis=width, max_voltage=full)
    _, u = loop(Actuator.of(p.actuator), 0.0, full, 0.0, full, 0.0, full)
    down, up = u[900:1200], u[1200:]
    assert np.ptp(u[600:]) == pytest.approx(p.actuator.gain * full, rel=1e-12)
    assert down[150] - up[150] == pytest.approx(width * p.actuator.gain * full, rel=1e-9, abs=1e-20)


def test_minor_loops_close_and_are_forgotten() -> None:
    """A small loop returns to where it left, and the large one goes on as if it had not been."""
    actuator = Actuator.of(hysteretic().actuator)
    r = actuator.thresholds
    memory = actuator.rest().moved(300.0, r).moved(0.0, r).moved(200.0, r)
    after = memory.moved(120.0, r).moved(200.0, r)
    assert actuator.deflection(after) == pytest.approx(actuator.deflection(memory), rel=1e-14)
    again = memory.moved(120.0, r).moved(180.0, r).moved(250.0, r)
    np.testing.assert_allclose(again.plays, memory.moved(250.0, r).plays)
    up, down = memory.moved(160.0, r), memory.moved(120.0, r).moved(160.0, r)
    assert actuator.deflection(down) < actuator.deflection(up)


@pytest.mark.parametrize("volts", [50.0, 300.0])
def test_follow_passes_through_every_sample(volts: float) -> None:
    """Its straight pieces give the same deflection as many small moves; none takes no time."""
    actuator = Actuator.of(hysteretic(hysteresis=0.3).actuator)
    memory = actuator.rest().moved(120.0, actuator.thresholds)
    ways = np.array([volts - 120.0, 0.0, -volts, 0.7 * volts, -0.2 * volts])
    spans = np.array([1e-3, 2e-4, 3e-6, 5e-3, 1e-9])
    durations, rates, after = actuator.follow(memory, spans, ways / spans)
    assert (durations > 0.0).all()
    assert durations.sum() == pytest.approx(spans.sum(), rel=1e-14)
    u = actuator.deflection(memory)
    assert u + durations @ rates == pytest.approx(actuator.deflection(after), abs=1e-20)
    ends, small = np.append(0.0, np.cumsum(durations)), memory
    path = u + np.append(0.0, np.cumsum(durations * rates))
    corners = np.append(0.0, np.cumsum(spans))
    for t in np.sort(np.append(np.linspace(0.0, spans.sum(), 3000), corners)):
        level = np.interp(t, corners, 120.0 + np.append(0.0, np.cumsum(ways)))
        small = small.moved(float(level), actuator.thresholds)
        assert np.interp(t, ends, path) == pytest.approx(actuator.deflection(small), abs=1e-14)


def test_follow_is_cut_anywhere() -> None:
    """Two halves of a segment lead where the whole leads: a device may stop in between."""
    actuator = Actuator.of(hysteretic().actuator)
    spans, rates = np.array([1e-3]), np.array([2.5e5])
    whole = actuator.follow(actuator.rest(), spans, rates)[2]
    half = actuator.follow(actuator.rest(), spans / 2, rates)[2]
    both = actuator.follow(half, spans / 2, rates)[2]
    assert isinstance(both, Memory)
    np.testing.assert_allclose([both.volts, *both.plays], [whole.volts, *whole.plays], rtol=1e-13)


# -- drives


def test_a_linear_actuator_is_one_without_a_loop() -> None:
    plain, none = drive_of(table_1()), drive_of(hysteretic(hysteresis=0.0))
    np.testing.assert_array_equal(none.durations, plain.durations)
    np.testing.assert_allclose(none.rates, plain.rates, rtol=1e-15)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("width", [0.05, 0.15, 0.4])
def test_the_drive_cycle_is_the_settled_loop(width: float, sign: int) -> None:
    """It closes, has the stroke of the full loop, bends as the rise and the slip of the loop do."""
    p = hysteretic(hysteresis=width)
    drive_cycle = drive_of(p, sign)
    u = sign * deflections(drive_cycle, np.linspace(0.0, drive_cycle.period, 2001))
    assert u[-1] == pytest.approx(0.0, abs=1e-20)
    assert u.max() == pytest.approx(STROKE, rel=1e-3)
    assert (drive_cycle.durations > 0.0).all()
    rise = float(np.sum(drive_cycle.durations[: drive_cycle.slip]))
    assert rise == pytest.approx(9.997e-3)
    assert drive_cycle.slip_duration == pytest.approx(3e-6)
    assert drive_cycle.slip_end == len(drive_cycle.durations)
    middle = sign * deflections(drive_cycle, np.array([rise / 2, rise + 1.5e-6]))
    assert middle[1] - middle[0] == pytest.approx(width * STROKE, rel=1e-9)


def test_a_loop_that_begins_high_is_settled_too(tmp_path: Path) -> None:
    """A table that begins at its top: the first cycle is as all others."""
    file = tmp_path / "high.csv"
    file.write_text("1\n0.2\n0.2\n0.6\n1\n")
    p = hysteretic(waveform="table", waveform_table=str(file))
    for sign in (1, -1):
        drive_cycle = drive_of(p, sign)
        actuator = Actuator.of(p.actuator)
        turns = [0.0, *(sign * 300.0 * level for level in (1, 0.2, 1, 0.2, 1))]
        _, u = loop(actuator, *turns)
        end = deflections(drive_cycle, np.array([drive_cycle.period * 0.25]))[0]
        assert end == pytest.approx(u[1200] - u[900])
        assert (drive_cycle.slip, drive_cycle.sign) == (0, sign)


def test_small_strokes_are_smaller_than_in_proportion() -> None:
    """A loop of half the voltage moves by less than half: the ends of the full loop are steeper."""
    p = hysteretic()
    half = float(strokes(p, 150.0))
    assert 0.4 * STROKE < half < 0.45 * STROKE
    drive_cycle = drive_of(p.replace(amplitude=150.0))
    rise = float(np.sum(drive_cycle.durations[: drive_cycle.slip]))
    assert deflections(drive_cycle, np.array([rise]))[0] == pytest.approx(half)
    column = p.replace(hysteresis=np.array([0.0, 0.15]))
    np.testing.assert_allclose(strokes(column, np.array([150.0, 150.0])), [STROKE / 2, half])


def test_levels_that_the_ceramics_bear() -> None:
    p = table_1(min_voltage=-60.0)
    check_voltage(p.actuator, -60.0)
    check_voltage(p.actuator, 300.0)
    for volts, words in (
        (-60.1, "-60.1 V is below min_voltage, -60 V, below which the actuator depolarises"),
        (300.1, "300.1 V is more than max_voltage, 300 V"),
        (float("nan"), "nan V"),
    ):
        with pytest.raises(ParameterError, match=words):
            check_voltage(p.actuator, volts)
    with pytest.raises(ParameterError, match="-1 V is below min_voltage"):
        check_voltage(table_1().actuator, -1.0)


def test_an_unknown_actuator() -> None:
    with pytest.raises(ParameterError, match="'squiggle'; known: linear, hysteresis"):
        drive_of(table_1(actuator="squiggle"))


# -- files


def test_a_file_gives_its_loop_at_the_gain_of_the_parameters(tmp_path: Path) -> None:
    """Weights count against each other; the full stroke is ``gain * max_voltage``."""
    file = tmp_path / "own.yaml"
    mine = Actuator(2e-10, np.array([20.0, 80.0]), np.array([1e-10, 3e-10]))
    file.write_text(hysteresis_text(mine, "of mine\ntoday"))
    actuator = Actuator.of(hysteretic(hysteresis_file=str(file)).actuator)
    assert actuator.stroke(300.0) == pytest.approx(STROKE)
    np.testing.assert_array_equal(actuator.thresholds, mine.thresholds)
    np.testing.assert_allclose(actuator.weights / actuator.elastic, mine.weights / mine.elastic)
    exact = hysteretic(hysteresis_file=str(file), gain=mine.stroke(300.0) / 300.0)
    assert Actuator.of(exact.actuator).elastic == pytest.approx(mine.elastic)


def test_a_broken_file_is_refused(tmp_path: Path) -> None:
    for text, words in [
        ("[1, 2]", "has to hold elastic, thresholds and weights"),
        ("elastic: 1.0\n", "has to hold elastic, thresholds and weights"),
        ("elastic: 1.0\nthresholds: [1.0]\nweights: [1.0, 2.0]", "1 thresholds, but 2 weights"),
        ("elastic: 1.0\nthresholds: [1.0]\nweights: [-1.0]", "value 1 of weights is not"),
        (
            "elastic: 1.0\nthresholds: [.nan]\nweights: [1.0]",
            "value 1 of thresholds is not a number of 0 or more",
        ),
        (
            "elastic: x\nthresholds: []\nweights: []",
            "value 1 of elastic is not a number of 0 or more",
        ),
        ("elastic: 0.0\nthresholds: []\nweights: []", "elastic is 0"),
        ("a: b: c", "is not a YAML file"),
    ]:
        file = tmp_path / "own.yaml"
        file.write_text(text)
        with pytest.raises(ParameterError, match=words) as error:
            drive_of(hysteretic(hysteresis_file=str(file)))
        assert str(file) in str(error.value)
    file.unlink()
    with pytest.raises(ParameterError, match=r"cannot read .*own\.yaml: No such file"):
        drive_of(hysteretic(hysteresis_file=str(file)))


@pytest.mark.parametrize("width", [0.0, 0.15, 0.4])
def test_the_voltage_for_a_stroke_has_that_stroke(width: float) -> None:
    actuator = Actuator.of(hysteretic(hysteresis=width).actuator)
    for volts in (0.0, 1e-3, 18.75, 40.0, 150.0, 299.0, 300.0):
        assert actuator.volts_for(actuator.stroke(volts)) == pytest.approx(volts, rel=1e-12)
