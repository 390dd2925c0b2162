# SPDX-License-Identifier: Apache-2.0
"""Comparison: the clock is found, what differs is named, what agrees is not."""

import json
import math
import re
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bench_traces import Axis, Drive, Sensor, bench_trace, random_axis
from table_1 import table_1

import stickslip_ros as ss
from stickslip_ros.base.reporting import to_json
from stickslip_ros.cli.main import main
from stickslip_ros.measurement.as_measured import simulate_as_measured, simulate_motion
from stickslip_ros.measurement.comparison import Comparison, compare_motions
from stickslip_ros.measurement.metric import METRICS
from stickslip_ros.measurement.metrics import significant
from stickslip_ros.measurement.motion_pair import ComparisonError, Fits
from stickslip_ros.measurement.steps.analysis import find_steps, runs_of
from stickslip_ros.measurement.steps.drive import Drive as Known
from stickslip_ros.measurement.steps.run import Run
from stickslip_ros.physics.parameters import Parameters
from stickslip_ros.simulation.motion import Motion
from stickslip_ros.simulation.sampling import PlannedRun, trace_runs, trace_steps
from stickslip_ros.simulation.steps import run_steps
from stickslip_ros.simulation.trace import save_csv

STEPS, OFFSET, NOISE = 12, 37e-6, 1e-9
PERIOD = 0.01  # s, of the drive


@cache
def run(**parameters: float) -> Motion:
    """Steps from rest with some parameters set."""
    return Motion.of_trace(trace_steps(table_1(**parameters), STEPS), "run")


def measured(
    motion: Motion,
    offset: float = OFFSET,
    rate: float = 100e3,
    level: float = 5e-8,
    gain: float = 1.0,
    drift: float = 0.0,
    seed: int = 1,
) -> Motion:
    """What a sensor with noise and a clock of its own would tell of a motion."""
    t = np.arange(motion.t[0], motion.t[-1], 1.0 / rate)
    x = level + gain * motion.position_at(t)
    x += np.random.default_rng(seed).normal(0.0, NOISE, len(t))
    return Motion("sensor", (1.0 + drift) * t + offset, x)


@cache
def compared(**parameters: float) -> Comparison:
    """The run with a measurement of an axis with some parameters set."""
    return compare_told(run(), measured(run(**parameters)))


def compare_told(run: Motion, sensor: Motion, fits: Fits | None = None) -> Comparison:
    """Compare with the runs of steps that a known period finds, a third of the time of a search."""
    return compare_motions(run, sensor, fits, runs=runs_of(sensor, Known.given(1.0 / PERIOD)))


def long(cycles: int, rate: float, **parameters: float) -> Motion:
    """A run from rest, its last step once more for every further cycle, on even samples."""
    source, period = run(**parameters), PERIOD
    t = np.arange(round(cycles * period * rate)) / rate
    last = source.t[-1] - period
    again = np.maximum(np.floor((t - last) / period + 1e-9), 0.0)
    begin, end = source.position_at(source.t[-1] - np.array([period, 0.0]))
    return Motion("long", t, source.position_at(t - again * period) + again * (end - begin))


def ramp() -> Motion:
    """A motion without steps."""
    t = np.linspace(0.0, 1.0, 4001)
    return Motion("ramp", t, 1e-6 * np.tanh((t - 0.4) / 0.05))


def metric(found: Comparison, name: str) -> Any:
    return next(metric for metric in found.metrics if metric.name == name)


@pytest.mark.parametrize(
    ("other", "differs"),
    [
        pytest.param({"sigma_1": 2.0}, "damping ratio", marks=pytest.mark.long),
        ({"sigma_1": 10.0}, "damping ratio"),
        ({"sigma_1": 20.0}, "damping ratio"),
        ({"mass": 5e-3}, "ringing frequency"),
        ({"preload": 1.0}, "ringing frequency"),
    ],
)
def test_the_clock_is_found_though_the_axis_is_another(
    other: dict[str, float], differs: str
) -> None:
    """Within 1 us at 1 nm of noise; with other damping alone within its own uncertainty, too."""
    found = compared(**other)
    error = abs(found.alignment.offset - OFFSET)
    assert error < 1e-6
    assert metric(found, differs).differs
    if "sigma_1" in other:
        assert error < 3.0 * found.alignment.offset_error
        assert found.alignment.offset_error < 1e-6


def test_a_trace_lies_on_itself() -> None:
    """Its samples are denser in the slips; they have to weigh no more for that."""
    found = compare_motions(run(), run())
    assert found.alignment.offset == pytest.approx(0.0, abs=1e-12)
    assert found.rmse < 1e-15


@pytest.mark.parametrize("offset", [-3.7e-3, pytest.param(5.0, marks=pytest.mark.long)])
def test_offsets_of_more_than_a_step_are_found(offset: float) -> None:
    found = compare_told(run(), measured(run(sigma_1=10.0), offset))
    assert found.alignment.offset == pytest.approx(offset, abs=1e-6)


@pytest.mark.long
@pytest.mark.parametrize(
    ("cycles", "off", "period"),
    [
        (150, 4e-6, 3e-4),
        (6000, 2e-6, 1e-5),
    ],
)
def test_a_minute_is_compared_as_a_second_is(cycles: int, off: float, period: float) -> None:
    """Errors of the period do not add up over the cycles, and the clock is not periods off."""
    found = compare_motions(
        long(cycles, 2.5e4), measured(long(cycles, 2.5e4, sigma_1=10.0), rate=2.5e4)
    )
    # In a minute, a twentieth of the time between samples: damping biases where slips begin.
    assert found.alignment.offset == pytest.approx(OFFSET, abs=off)
    assert abs(found.alignment.offset - OFFSET) < 2.0 * found.alignment.offset_error
    for steps in (found.main.run, found.main.measured):
        assert steps is not None
        assert cycles - 1 <= len(steps.slips) <= cycles  # the last slip is where the record ends
    assert metric(found, "period").run == pytest.approx(0.01, rel=1e-7)
    assert metric(found, "period").tolerance < period * 0.01
    assert "period" not in found.differing
    assert "damping ratio" in found.differing


@pytest.mark.parametrize("sigma_1", [3.0, pytest.param(10.0, marks=pytest.mark.long)])
def test_the_clock_is_found_though_the_ringing_dies_away_otherwise(sigma_1: float) -> None:
    """With the weaker damping no onset came out: the matrix was singular."""
    found = compare_told(long(20, 1e5), measured(long(20, 1e5, sigma_1=sigma_1), rate=1e5))
    assert abs(found.alignment.offset - OFFSET) < 3e-6


@pytest.mark.parametrize("off", [37e-6, pytest.param(62e-6, marks=pytest.mark.long)])
def test_straight_lines_between_coarse_samples_count_as_uncertain(off: float) -> None:
    """At 3.3 samples in a period of ringing, the clock was 2.7 us off, stated as 0.3 us."""
    found = compare_told(long(30, 2.5e4), measured(long(30, 2.5e4, sigma_1=10.0), off, rate=2.5e4))
    assert abs(found.alignment.offset - off) < 2.0 * found.alignment.offset_error
    assert found.alignment.offset_error < 3e-6


def test_a_measurement_that_agrees_differs_in_nothing_but_noise() -> None:
    for found in (
        compared(),
        compare_motions(run(), measured(run(), seed=2)),
    ):  # the period is found, too
        assert found.differing == []
        assert found.rmse == pytest.approx(NOISE, rel=0.03)
        assert found.noise == pytest.approx(NOISE, rel=0.03)
        assert abs(found.alignment.offset - OFFSET) < 0.3e-6


def test_a_difference_counts_from_what_chance_hardly_exceeds() -> None:
    """Three standard errors if it were the only one, 3.64 of ten; the measured step is that of
    `find_runs`, with its own error.
    """
    assert [significant(1), significant(10)] == pytest.approx([3.0, 3.64], abs=5e-3)
    assert len(METRICS) == len(compared().metrics) - 1  # but for the count of steps, which is exact
    found = compared()
    own, (other,) = found.main.run, found.runs
    assert own is not None
    limit = significant(len(METRICS)) * math.hypot(own.step_size_error, other.step_size_error)
    # Beside it, what samples and a draw of the noise do to the run.
    assert 1.0 < metric(found, "step size").tolerance / max(limit, 1e-10) < 1.1
    assert metric(found, "step size").measured == other.step_size


def test_the_rest_before_the_steps_tells_where_they_begin() -> None:
    """With a fifth less preload, what differs is as little a tenth of a period away."""
    random = np.random.default_rng(1)
    axis = random_axis(random)
    frequency = float(np.exp(random.uniform(np.log(60.0), np.log(2e3))))
    cycles, volts = int(random.integers(8, 25)), float(random.uniform(150.0, 300.0))
    rest = 3.0 / frequency
    drive = Drive(cycles, frequency, volts, pause=rest)
    bench = bench_trace(axis, (drive,), Sensor(rate=1e5, noise=1e-9), rest, seed=1)
    sensor = Motion("sensor", bench.t, bench.x)
    runs = runs_of(sensor, Known.given(frequency))
    less = {"preload": 0.8 * axis.preload, "frequency": frequency, "amplitude": volts}
    simulated = simulate_as_measured(
        Parameters.of({**axis.parameters, **less}), sensor, runs, "simulation"
    )
    found = compare_motions(simulated, sensor, runs=runs)
    assert abs(found.alignment.offset - bench.runs[0].start) * frequency < 0.03


@pytest.mark.parametrize(("begin", "end"), [(0.0, 0.135), (0.056, 1.0), (0.056, 0.135)])
def test_a_record_that_is_cut_within_a_cycle_is_compared_with_as_much_of_the_run(
    begin: float, end: float
) -> None:
    """The run rested where the record went on: its clock seemed to be off by half a millisecond."""
    p = Parameters.of({"frequency": 100.0})
    whole = Motion("run", *trace_runs(p, [PlannedRun(0.0, 12)], before=0.02, after=0.03))
    t = np.arange(-0.02, 0.148, 2e-5)
    x = whole.position_at(t) + np.random.default_rng(4).normal(0.0, 2e-9, len(t))
    sensor = Motion("sensor", t + 0.02, x).between(begin, end)
    runs = runs_of(sensor, Known.given(100.0))
    found = compare_motions(simulate_as_measured(p, sensor, runs, "run"), sensor, runs=runs)
    assert found.rmse < 2.2e-9
    assert abs(found.alignment.offset - (0.05 if begin else 0.02)) < 2e-6  # begin of the cycle
    assert found.differing == []


@cache
def to_and_fro(**parameters: float) -> Motion:
    """Ten steps forward, eight backward after a rest."""
    runs = [PlannedRun(0.0, 10), PlannedRun(0.13, -8)]
    return Motion("run", *trace_runs(table_1(**parameters), runs, before=0.02, after=0.03))


@pytest.mark.long
def test_each_run_of_steps_is_compared_with_its_own() -> None:
    """Forward and backward: the run had no steps, so nothing ever differed."""
    t = np.arange(to_and_fro().t[0], to_and_fro().t[-1], 2e-5)
    x = to_and_fro().position_at(t) + np.random.default_rng(4).normal(0.0, NOISE, len(t))
    x += 2e-9 * np.sin(100.0 * np.pi * t) + 5e-8 * t  # hum and drift are none of the steps
    sensor = Motion("sensor", t, x)
    runs = runs_of(sensor, Known.given(100.0))
    true = compare_motions(to_and_fro(), sensor, runs=runs)
    assert true.differing == []
    assert [one.measured.direction for one in true.pairs if one.measured] == [1, -1]
    for pair in true.pairs:
        step = next(one for one in pair.metrics if one.name == "step size")
        assert step.tolerance < 2e-9
        assert abs(step.difference) < 0.5e-9
    other = compare_motions(to_and_fro(preload=0.48), sensor, runs=runs)
    assert "step size" in other.differing
    assert [len(other.as_json()["by_run"]), other.as_json()["steps"]] == [2, 18]
    half = other.run.between(-1.0, 0.11)
    assert half.u is not None
    held = np.concatenate((half.t, [0.16, 0.21, 0.26]))
    still = [np.append(column, column[[-1] * 3]) for column in (half.x, half.u)]
    stopped = compare_motions(
        Motion("run", held, still[0], u=still[1]), sensor, Fits(offset=False), runs=runs
    )
    assert "the run has no such steps" in stopped.pairs[1].metrics[0].why_missing
    assert stopped.pairs[0].metrics[1].differs
    assert [one.kept for one in stopped.judge({"backstep-error": 1.0})] == [False]
    assert "cannot be determined" in stopped.judge({"step-error": 1.0})[0].judgement


@pytest.mark.long
def test_slips_that_the_search_finds_late_are_judged_alike_in_both() -> None:
    """Ringing that lasts hid the slips, and the backstep of the true run differed by a fifth."""
    axis = Axis(0.59682, 7.4904e-3, 3.14516, 7.39566e6, 1.422245e7)
    drive, sensor = Drive(24, 180.2985, 210.832, 1, 0.0111), Sensor(rate=2e5, noise=1.6e-9)
    bench = bench_trace(axis, (drive,), sensor, 8e-3, 48015)
    known = {**axis.parameters, "frequency": drive.frequency, "amplitude": drive.amplitude}
    found = ss.compare(known, Motion("bench", bench.t, bench.x))
    assert found.differing == []
    assert abs(metric(found, "backstep").difference) < 6e-9


@pytest.mark.long
def test_a_run_that_is_not_determined_is_left_out_beside_one_that_is() -> None:
    """A phantom of two cycles in the hum of a rest set the clock, and was simulated, too."""
    t = np.arange(to_and_fro().t[0], to_and_fro().t[-1], 2e-5)
    x = to_and_fro().position_at(t) + np.random.default_rng(4).normal(0.0, NOISE, len(t))
    sensor = Motion("sensor", t, x)
    runs = find_steps(t, x, Known.given(100.0)).runs
    for k, steps in ((0, -8), (1, 10)):
        some = list(runs)
        some[k] = replace(some[k], doubts=("2 cycles",))
        simulated = simulate_as_measured(table_1(), sensor, some, "run")
        found = compare_motions(simulated, sensor, runs=some, period=PERIOD)
        assert found.differing == []
        assert found.rmse < 2.0 * NOISE
        assert [one.left_out for one in found.pairs] == [k == 0, k == 1]
        assert found.main.run is not None
        assert found.main.run.direction * found.main.run.steps == steps
        assert found.as_json()["steps"] == abs(steps)
        assert any("left out: 2 cycles" in note for note in found.notes())
        (said,) = found.judge({"step-error": 1.0})
        assert not said.kept
        assert "2 cycles" in said.judgement


def test_a_limit_is_kept_by_what_can_be_known_alone() -> None:
    """A difference of 1.4 nm kept a limit of 2 nm, its tolerance 97 nm, its run doubted."""
    whole = measured(run())
    runs = without_doubts(whole)
    found = compare_motions(run(), whole, runs=runs)
    step = metric(found, "step size")
    assert abs(step.difference) < 0.9 * step.tolerance
    (kept,) = found.judge({"step-error": 1.1 * step.tolerance})
    (coarse,) = found.judge({"step-error": 0.9 * step.tolerance})
    assert (kept.kept, coarse.kept) == (True, False)
    assert "cannot be determined (its tolerance is " in coarse.judgement
    runs = [replace(one, doubts=("it was cut off",)) for one in runs]
    (doubted,) = compare_motions(run(), whole, runs=runs).judge({"step-error": 1.0})
    assert not doubted.kept
    assert "is not determined: it was cut off" in doubted.judgement


def test_another_period_than_that_of_the_parameters_differs_in_every_run() -> None:
    """The run was simulated at the measured frequency, so a wrong one agreed."""
    t = np.arange(to_and_fro().t[0], to_and_fro().t[-1], 2e-5)
    x = to_and_fro().position_at(t) + np.random.default_rng(4).normal(0.0, NOISE, len(t))
    sensor, told = Motion("sensor", t, x), table_1(frequency=110.0)
    runs = find_steps(t, x, Known.given(100.0)).runs
    simulated = simulate_as_measured(told, sensor, runs, "run")
    found = compare_motions(simulated, sensor, runs=runs, period=1.0 / 110.0)
    assert [one.verdict for one in found.pairs] == ["period differs"] * 2
    assert metric(found, "period").run == pytest.approx(1.0 / 110.0)


@pytest.mark.parametrize("blind", [False, pytest.param(True, marks=pytest.mark.long)])
@pytest.mark.parametrize(
    ("steps", "rest", "differs"),
    [(12, 0.02, False), (12, 0.0, False), (10, 0.0, True), (10, 0.02, True), (11, 0.02, True),
     pytest.param(13, 0.02, True, marks=pytest.mark.long)],
)  # fmt: skip
def test_another_number_of_steps_differs(
    steps: int, rest: float, differs: bool, blind: bool
) -> None:
    """Ten steps agreed with twelve: only the time in common was looked at."""
    long = simulate_motion(table_1(), [PlannedRun(0.0, steps)], "run", rest, 1.5 * rest)
    sensor = measured(simulate_motion(table_1(), [PlannedRun(0.0, 12)], "axis", 0.02, 0.03))
    found = compare_told(measured(long, seed=2) if blind else long, sensor)
    count = metric(found, "steps")
    if blind and not rest:  # where a record begins or ends, steps without rest may be cut off
        assert count.differs is None
        return
    assert (count.run, count.measured, count.differs) == (steps, 12, differs)
    assert any(f"steps: {steps} and 12" in note for note in found.notes()) == differs


@pytest.mark.parametrize("part", [0.4, 0.7])
def test_a_drive_that_stops_within_a_cycle_has_no_whole_number_of_steps(part: float) -> None:
    """30.4 steps were called equal to 30."""
    longer = simulate_motion(table_1(), [PlannedRun(0.0, 13)], "axis", 0.02, 0.03)
    stop = (12.0 + part) / table_1().drive.frequency
    held = longer.position_at(np.minimum(longer.t, stop))
    sensor = measured(replace(longer, x=held, v=None, u=None))
    twelve = simulate_motion(table_1(), [PlannedRun(0.0, 12)], "run", 0.02, 0.03)
    found = compare_told(twelve, sensor)
    count = metric(found, "steps")
    assert count.differs is None
    shown = 12.0 + (held[-1] - twelve.x[-1]) / metric(found, "step size").run
    assert f"12 cycles each, but {shown:.1f} steps" in count.why_missing


def test_of_offsets_that_fit_alike_the_one_with_most_time_in_common_is_taken() -> None:
    """Nothing but settled steps: no rest shows which is which."""
    middle = run().between(0.0305, 0.1155)
    assert middle.v is not None
    found = compare_told(middle, measured(middle, offset=0.05 + OFFSET))
    assert metric(found, "steps").differs is None
    assert found.alignment.offset == pytest.approx(0.05 + OFFSET, abs=1e-6)
    assert found.alignment.other_offset is not None
    assert any("most time in common" in note for note in found.notes())


@pytest.mark.long
def test_gain_and_drift_are_fitted_if_asked() -> None:
    sensor = measured(run(), gain=1.02, drift=1e-4)
    found = compare_told(run(), sensor, Fits(drift=True, gain=True))
    assert found.alignment.gain == pytest.approx(1.02, rel=1e-4)
    assert found.alignment.drift == pytest.approx(1e-4, abs=1e-5)
    plain = compare_motions(run(), sensor, runs=found.runs)
    assert (plain.alignment.gain, plain.alignment.drift) == (1.0, 0.0)
    assert plain.rmse > 3.0 * found.rmse
    still = replace(run(), x=np.full_like(run().x, 1e-7), v=None, u=None)
    other_way, asked = replace(sensor, x=-sensor.x), Fits(offset=False, gain=True)
    with pytest.raises(ComparisonError, match="goes the other way"):
        compare_motions(run(), other_way, asked, runs=found.runs)
    with pytest.raises(ComparisonError, match="no gain to fit"):
        compare_motions(still, sensor, asked, runs=found.runs)


def test_what_is_not_fitted_is_taken_as_it_is() -> None:
    fits = Fits(offset=False, level=False)
    found = compare_told(run(), measured(run(), offset=0.0, level=1e-7), fits)
    assert (found.alignment.offset, found.alignment.level) == (0.0, 0.0)
    assert found.rmse == pytest.approx(1e-7, rel=0.01)
    with pytest.raises(ComparisonError, match="hardly overlap"):
        compare_motions(run(), measured(run(), offset=10.0), fits, runs=found.runs)


def test_a_motion_without_steps_is_compared_all_the_same() -> None:
    found = compare_motions(ramp(), Motion("sensor", ramp().t + 0.02, ramp().x))
    assert found.alignment.offset == pytest.approx(0.02, abs=1e-5)
    assert all(metric.differs is None and metric.why_missing for metric in found.metrics)


def test_an_error_of_the_steps_and_one_of_the_shape() -> None:
    """Three nanometres more in every slip add up; a swing of 5 nm, four to a cycle, does not."""
    t = np.arange(0.0, STEPS * 0.01, 1e-5)
    x, u = run().position_at(t), run().u
    assert u is not None
    plain = Motion("run", t, x, u=np.interp(t, run().t, u))
    more = 3e-9 * np.searchsorted(0.01 * np.arange(1, STEPS + 1), t, side="right")
    swing = 5e-9 * np.sin(2.0 * np.pi * 400.0 * t)
    longer, shaken = (
        compare_told(plain, Motion("sensor", t, x + one), Fits(offset=False))
        for one in (more, swing)
    )
    assert longer.rmse == pytest.approx(np.std(more), rel=1e-3)
    assert longer.step_rmse == pytest.approx(np.std(more), rel=0.01)
    assert longer.shape_rmse < 0.3e-9
    assert longer.as_json()["step_rmse"] == longer.step_rmse
    assert shaken.shape_rmse == pytest.approx(5e-9 / np.sqrt(2.0), rel=0.01)
    assert shaken.step_rmse < 0.1e-9
    shape = float(np.sqrt(np.mean(shaken.shape_difference**2)))
    assert shape == pytest.approx(shaken.shape_rmse, rel=1e-3)


def test_steps_and_shape_make_the_whole() -> None:
    """Another preload changes the steps most, another damping the shape alone."""
    for parameters, of_steps in (({"preload": 1.0}, 0.9), ({"sigma_1": 10.0}, 0.0)):
        found = compared(**parameters)
        both = np.hypot(found.step_rmse, found.shape_rmse)
        assert both == pytest.approx(found.rmse, rel=1e-12)
        share = found.step_rmse / found.rmse
        assert share > of_steps if of_steps else share < 0.5
    assert [one.kept for one in found.judge({"step-rmse": 1.0, "shape-rmse": 1e-12})] == [
        True, False,
    ]  # fmt: skip
    assert np.isnan(compare_motions(ramp(), ramp()).shape_rmse)


def without_doubts(motion: Motion) -> list[Run]:
    """The runs of a motion, as if it showed the rests beside them."""
    return [replace(one, doubts=()) for one in runs_of(motion, Known.given(1.0 / PERIOD))]


@pytest.mark.parametrize(
    ("axis", "drive", "sensor", "part"),
    [
        pytest.param(
            Axis(1.0083, 7.5639e-3, 6.3427, 5.11027e6, 1.057267e7),
            Drive(11, 942.238, 189.1767, 1, 4e-3),
            Sensor(2e5, 1.9e-9, hum=1.2e-9, drift=1.07e-7, offset=0.0171),
            0.8,
            id="the rest between them rang like three cycles of 1 +- 28 nm",
        ),
        pytest.param(
            Axis(1.0221, 3.759e-3, 3.1334, 6.07155e6, 1.057564e7),
            Drive(18, 1126.01, 253.512, 1, 4e-3),
            Sensor(2e5, 5.4e-10, offset=-0.446),
            1.2,
            id="the whole motions lie best over one another 0.28 of a cycle late",
        ),
    ],
)
def test_runs_there_and_back_are_compared_run_by_run(
    axis: Axis, drive: Drive, sensor: Sensor, part: float
) -> None:
    bench = bench_trace(axis, (drive, replace(drive, direction=-1)), sensor, 8e-3, 930025)
    measured = Motion("bench", bench.t, bench.x)
    known = {**axis.parameters, "frequency": drive.frequency, "amplitude": drive.amplitude}
    true = ss.compare(known, measured)
    assert [pair.verdict for pair in true.pairs] == ["agrees", "agrees"]
    wrong = ss.compare({**known, "preload": part * axis.preload}, measured)
    assert len(wrong.pairs) == 2
    assert all("step size" in pair.verdict for pair in wrong.pairs)


@pytest.mark.long
def test_analyse_and_compare_show_the_same_numbers(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """By JSON of both commands, text, table and library: 48.6 and 47.9 nm were shown of one file.

    There and back had no backstep at all; the trace has an actuator.
    """
    trace, table = str(tmp_path / "trace.csv"), tmp_path / "runs.csv"
    save_csv(trace_steps(table_1(), STEPS), Path(trace))

    def output(*arguments: str) -> str:
        main([*arguments])
        return capsys.readouterr().out

    for file in ("there_and_back.csv", trace):
        analyse = ("analyse", file, "--frequency", "100")
        analysed = json.loads(output(*analyse, "--table", str(table), "--json"))
        options = ("--set", "frequency=100", "--json")
        both = json.loads(output("compare", "table1_typical.yaml", file, *options))
        text, found = output(*analyse), ss.analyse(file, frequency=100.0)
        rows = np.atleast_1d(np.genfromtxt(table, delimiter=",", names=True))
        assert both["runs"] == analysed["runs"]
        main_one = max(analysed["runs"], key=lambda one: one["steps"])
        for name in ("step_size", "backstep"):
            values, metric = [run[name] for run in analysed["runs"]], name.replace("_", " ")
            assert [one["metrics"][metric]["measured"] for one in both["by_run"]] == values
            known = [math.nan if value is None else value for value in values]
            assert rows[f"{name}_m"] == pytest.approx(known, nan_ok=True)
            assert analysed[name] == main_one[name] == to_json(getattr(found, name))
            if main_one[name] is None:
                assert "not determined" in text
                continue
            shown = re.findall(r"(\d+\.(\d+)) nm", text)  # with its decimals
            assert any(f"{1e9 * main_one[name]:.{len(n)}f}" == number for number, n in shown)
        assert analysed["balance"]["step"] == main_one["direction"] * main_one["step_size"]
        assert analysed["balance"]["backstep"] == analysed["backstep"]
    true = run_steps(table_1(), STEPS)
    assert found.step_size == pytest.approx(true.step_size, abs=3.0 * found.step_size_error + 1e-14)
    assert found.backstep == pytest.approx(true.backstep, abs=3.0 * found.backstep_error + 1e-11)


def test_a_clock_is_found_where_samples_do_not_show_the_ringing() -> None:
    """The ringing in the slips has no best frequency then; the fit went on to 0, and divided by it.

    Behind a resonance of the actuator, which is as fast as the samples.
    """
    drive: dict[str, Any] = {
        **{"model": "lugre", "preload": 0.668, "mass": 1.11e-3, "mu_k": 0.14, "mu_s": 0.16},
        **{"sigma_0": 9.09e6, "sigma_1": 8.48, "v_stribeck": 0.029, "frequency": 43.07},
        **{"amplitude": 91.0, "actuator_resonance": 50541.0, "actuator_damping": 0.338},
    }
    trace = ss.simulate(drive, steps=-20).trace_at(2e4)
    x = np.concatenate([np.full(900, trace.x[0]), trace.x, np.full(900, trace.x[-1])])
    t = np.arange(len(x)) / 2e4
    found = ss.compare({**drive, "mu_k": 0.162}, (t, x))
    # The rest before the steps; two samples are as much as such a record tells.
    assert found.alignment.offset == pytest.approx(0.045, abs=1e-4)
