# SPDX-License-Identifier: Apache-2.0
"""What a record does not hold is said, and what it holds is not doubted."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from bench_traces import Axis, Bench, Drive, Sensor, bench_trace

from stickslip_ros.arrays import Array
from stickslip_ros.traces.analysis import analyse_steps, find_runs
from stickslip_ros.traces.doubts import doubts_of, find_clipping
from stickslip_ros.traces.even_samples import EvenSamples, SlipGrid, noise_of, resample_evenly
from stickslip_ros.traces.folding import shorter_period
from stickslip_ros.traces.measured_value import MeasuredValue
from stickslip_ros.traces.ringing import Ringing

FREQUENCY, COUNT = 200.0, 18


@pytest.fixture(scope="module")
def bench() -> Bench:
    drives = (Drive(COUNT, FREQUENCY, pause=0.012),)
    return bench_trace(Axis(), drives, Sensor(rate=50e3, noise=2e-9, drift=1e-7), rest=0.015)


def _grid(bench: Bench, period: float = 1.0, count: int = COUNT) -> SlipGrid:
    """The true run; period and number of cycles as they may be misjudged."""
    every = period / FREQUENCY
    return SlipGrid(bench.runs[0].start + every, every, count, 1, 1e-7, 1.0)


def _even(bench: Bench, every: int = 1, first: float = -1.0, last: float = 9.0) -> EvenSamples:
    """The record from a first to a last time (s), every so-manyth sample of it."""
    kept = (bench.t > first) & (bench.t < last)
    return resample_evenly(bench.t[kept][::every], bench.x[kept][::every], 2**20)


def _doubts(
    even: EvenSamples, grid: SlipGrid, others: list[SlipGrid], step: float, *more: Any
) -> tuple[str, ...]:
    return doubts_of(even, grid, others, MeasuredValue(step, 0.0), *more)


def _clipping(x: Array) -> tuple[str, ...]:
    return find_clipping(x, noise_of(x))


def test_a_run_between_two_rests_is_determined(bench: Bench) -> None:
    assert _doubts(_even(bench), _grid(bench), [], bench.runs[0].step_size, None) == ()


def test_ringing_nearly_in_step_with_the_drive_makes_no_doubt() -> None:
    """Ringing of 7.5 kHz repeats four or five times in a cycle, the slip does not."""
    for frequency in (1480.0, 1840.0, 29.0):
        rest = max(3.0 / frequency, 5e-3)
        sensor = Sensor(rate=1e5 if frequency < 100.0 else 2e5, noise=2e-9)
        bench = bench_trace(Axis(sigma_1=3.0), (Drive(16, frequency, pause=rest),), sensor, rest)
        (run,) = bench.runs
        grid = SlipGrid(run.start + 1.0 / frequency, 1.0 / frequency, 16, 1, 1e-7, 1.0)
        ringing = Ringing(*bench.axis.ringing)
        assert _doubts(_even(bench), grid, [], run.step_size, None, ringing) == ()


@pytest.mark.parametrize(
    ("period", "count", "scale", "words"),
    [
        (3.0, COUNT // 3, 3.0, "the motion repeats better at 200 Hz"),
        (2.0, COUNT // 2, 2.0, "the motion repeats better at 200 Hz"),
        (1.31, COUNT, 1.0, "differs from cycle to cycle"),
        (1.0, COUNT - 2, 1.0, "16 or 17 steps"),
        (1.0, COUNT - 4, 1.0, "steps apart, but 14 cycles are seen"),
        (1.0, 2, 1.0, "2 cycles; 3 are needed"),
    ],
)
def test_a_run_that_is_misjudged_is_doubted(
    bench: Bench, period: float, count: int, scale: float, words: str
) -> None:
    """Multiples of the period, a wrong one, too few cycles counted, too few at all."""
    step = scale * bench.runs[0].step_size
    even, grid = _even(bench), _grid(bench, period, count)
    found = _doubts(even, grid, [], step, shorter_period(even, grid))
    assert any(words in one for one in found), found


def test_without_rest_step_and_drift_are_one(bench: Bench) -> None:
    """One rest is enough to tell them apart."""
    run, grid = bench.runs[0], _grid(bench)
    step = run.step_size
    inner = replace(grid, first=grid.first + 3.0 / FREQUENCY, count=COUNT - 6)
    begin, end = inner.begin + 0.1 / FREQUENCY, inner.end + 0.2 / FREQUENCY
    (found,) = _doubts(_even(bench, first=begin, last=end), inner, [], step, None)
    assert found == "no rest beside the run, so step and drift cannot be told apart"
    late = inner.end + 0.9 / FREQUENCY  # another rise, or a rest and a drift
    (found,) = _doubts(_even(bench, first=begin, last=late), inner, [], step, None)
    assert found.startswith("no rest beside the run")
    assert _doubts(_even(bench, last=run.end), grid, [], step, None) == ()


def test_few_samples_are_said(bench: Bench) -> None:
    found = _doubts(_even(bench, every=36), _grid(bench), [], bench.runs[0].step_size, None)
    assert any("are 6.9 a cycle at 200 Hz; 10 are needed" in one for one in found), found


def test_a_rest_in_which_the_runner_steps_is_none(bench: Bench) -> None:
    """Half of the cycles are missed: the rest after the run holds them."""
    step = bench.runs[0].step_size
    found = _doubts(_even(bench), _grid(bench, count=COUNT // 2), [], step, None)
    assert any("after the run, about as far as in a step" in one for one in found), found


def test_what_no_run_explains_is_doubted(bench: Bench) -> None:
    grid = replace(_grid(bench), explained=False)
    found = _doubts(_even(bench), grid, [], bench.runs[0].step_size, None)
    assert found == ("no run of equal steps explains the motion",)


def test_a_run_back_leaves_no_doubt() -> None:
    """The rest between two runs tells of both, no rest of none."""
    drives = (Drive(12, FREQUENCY, pause=0.01), Drive(9, FREQUENCY, direction=-1, pause=0.02))
    bench = bench_trace(Axis(), drives, Sensor(rate=50e3, noise=2e-9), rest=0.01)
    even = _even(bench)
    grids = [
        SlipGrid(run.start + 1 / FREQUENCY, 1 / FREQUENCY, run.steps, run.direction, 1e-7, 1.0)
        for run in bench.runs
    ]
    for run, grid, other in zip(bench.runs, grids, grids[::-1], strict=True):
        assert _doubts(even, grid, [other], run.step_size, None) == ()
    exact = replace(even, noise=0.0)  # without noise, drift and step are one as well
    inner = slice(*np.searchsorted(bench.t, [grids[0].begin, grids[0].end]))
    alone = replace(exact, begin=float(bench.t[inner][0]), x=even.x[inner], known=even.known[inner])
    (found,) = _doubts(alone, grids[0], [], bench.runs[0].step_size, None)
    assert "no rest beside the run" in found


def test_a_record_that_was_cut_off_is_doubted(bench: Bench) -> None:
    """The sensor ends at 0.9 of the way; a coarse converter alone makes no doubt."""
    step = bench.runs[0].step_size
    (text,) = _clipping(np.minimum(bench.x, 0.9 * COUNT * step))
    assert "outermost value" in text
    (text,) = _clipping(np.minimum(bench.clean, 0.9 * COUNT * step))
    assert "outermost value" in text
    assert not _clipping(bench.clean)
    coarse = replace(bench, x=1e-8 * np.round(bench.x / 1e-8))
    assert _doubts(_even(coarse), _grid(coarse), [], step, None) == _clipping(coarse.x) == ()


@pytest.mark.slow
def test_a_rest_on_one_value_of_a_converter_is_not_cut_off() -> None:
    """Uneven times hide the steps of the converter from positions at even ones."""
    sensor = Sensor(rate=1e5, noise=0.1e-9, quantum=2e-9, jitter=0.5)
    drives = (Drive(26, 1906.0, amplitude=150.0, pause=3e-3),)
    bench = bench_trace(Axis(sigma_1=9.0), drives, sensor, rest=3e-3)
    assert np.count_nonzero(bench.x == bench.x.min()) > 100
    (run,) = find_runs(bench.t, bench.x)
    assert (run.steps, run.doubts) == (26, ())


def test_ringing_is_neither_a_shorter_period_nor_a_move(bench: Bench) -> None:
    """After fast cycles, the ringing of 1.2 periods later still swings by more than a step."""
    drive = Drive(30, 2400.0, amplitude=90.0, pause=0.004)
    fast = bench_trace(Axis(), (drive,), Sensor(rate=200e3, noise=1e-9), rest=0.006)
    (run,) = fast.runs
    grid = SlipGrid(run.start + 1.0 / 2400.0, 1.0 / 2400.0, run.steps, 1, 1e-8, 1.0)
    ringing = Ringing(*fast.axis.ringing)
    swing = 1.01 / ringing.frequency
    assert _doubts(_even(fast), grid, [], run.step_size, swing, ringing) == ()
    found = _doubts(_even(fast), grid, [], run.step_size, 2.0 * swing, None)
    assert "no run of equal steps" in found[0]
    assert "repeats better" in found[1]


def test_cycles_of_the_mains_without_ringing_may_be_hum() -> None:
    """Of a drive at 50 Hz, ringing tells the slips from hum, and so does a given frequency."""
    bench = bench_trace(Axis(), (Drive(12, 50.0, pause=0.05),), Sensor(rate=2e4), rest=0.05)
    (run,) = bench.runs
    grid = SlipGrid(run.start + 0.02, 0.02, run.steps, 1, 1e-7, 1.0)
    for given in (True, False):
        found = _doubts(_even(bench), grid, [], run.step_size, None, None, given)
        assert ["the mains" in one for one in found] == [True] * (not given)


def test_slips_that_are_not_evenly_spaced_are_doubted(bench: Bench) -> None:
    """Each cycle a bit shorter than the one before; their mean backstep was a third of the true."""
    drives = tuple(Drive(1, FREQUENCY * 1.005**k, pause=0.0 if k else 0.012) for k in range(COUNT))
    sweep = bench_trace(Axis(), drives, Sensor(rate=50e3, noise=2e-9), rest=0.015)
    slips = np.array([run.end for run in sweep.runs])
    period, first = np.polyfit(np.arange(COUNT), slips, 1)
    grid = SlipGrid(float(first), float(period), COUNT, 1, 1e-7, 1.0)
    ringing = Ringing(*sweep.axis.ringing)
    for made, run, said in ((sweep, grid, True), (bench, _grid(bench), False)):
        found = _doubts(_even(made), run, [], bench.runs[0].step_size, None, ringing)
        assert any("the slips miss even times" in one for one in found) is said, found


def test_every_tenth_of_fast_cycles_is_doubted() -> None:
    """43 samples of ten cycles repeat as those of one: 5 steps of 1 um for 55 of a tenth."""
    bench = bench_trace(Axis(), (Drive(55, 2200.0, pause=0.004),), Sensor(rate=9460.0), rest=0.004)
    run = bench.runs[0]
    grid = SlipGrid(run.start + 10.0 / 2200.0, 10.0 / 2200.0, 5, 1, 1e-6, 1.0)
    found = _doubts(_even(bench), grid, [], 10.0 * run.step_size, None)
    assert "no run of equal steps explains the motion" in found


@pytest.mark.slow
@pytest.mark.parametrize("part", [0.0, 0.4, -0.3])
def test_a_start_within_a_cycle_is_doubted(bench: Bench, part: float) -> None:
    """It made steps of the right size and a backstep of nothing."""
    start = bench.runs[0].start + part / FREQUENCY
    (doubt, *more) = [*analyse_steps(bench.t, bench.x, frequency=FREQUENCY, start=start).doubts, ""]
    assert doubt.startswith(f"the runner falls {-part:+.2f} of a cycle away" if part else "")
    assert bool(more) is bool(part)
