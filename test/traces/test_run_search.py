# SPDX-License-Identifier: Apache-2.0
"""Runs are found in traces as they come from a bench, and nowhere else."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from bench_traces import Axis, Drive, Sensor, bench_trace, random_bench

from stickslip_ros.traces.analysis import STAGES, find_runs, find_steps
from stickslip_ros.traces.cycles import Cycles
from stickslip_ros.traces.ringing import Ringing
from stickslip_ros.traces.runs import after_slip, main_run
from stickslip_ros.traces.step_analysis import analyse_cycles

pytestmark = pytest.mark.slow

RATE, NOISE = 50e3, 2e-9
T = np.arange(0.0, 0.2, 1.0 / RATE)


@pytest.mark.parametrize(
    ("seed", "known"),
    [
        (0, False),
        (4, True),
        *(pytest.param(*one, marks=pytest.mark.long) for one in product((2, 6, 8), (True, False))),
    ],
)
def test_runs_and_steps_of_traces_by_lot(seed: int, known: bool) -> None:
    """Rest, 10 to 30 cycles, rest: number, size within three standard errors, start."""
    bench = random_bench(seed, hard=False)
    (true,) = bench.runs
    (run,) = find_runs(bench.t, bench.x, 1.0 / true.frequency if known else None)
    assert (run.steps, run.direction) == (true.steps, true.direction)
    assert run.frequency == pytest.approx(true.frequency, rel=1e-3)
    assert abs(run.step_size - true.step_size) < 3.0 * run.step_size_error
    assert run.step_size_error < 0.3e-9
    assert abs(run.start - true.start) * true.frequency < 0.3


@pytest.mark.filterwarnings("error")
def test_what_is_not_known_warns_nobody() -> None:
    """A gap of 2.6 cycles in a run has no mean; both sides of it are in step, so it is one run."""
    drives = (Drive(24, 400.0, pause=0.008), Drive(6, 400.0, direction=-1, pause=0.007))
    bench = bench_trace(Axis(), drives, Sensor(rate=50e3, noise=2e-9), rest=0.008)
    since = bench.t - bench.runs[0].start
    kept = (since < 11.3 / 400.0) | (since > 13.9 / 400.0)
    found = find_runs(bench.t[kept], bench.x[kept], 1.0 / 400.0)
    assert [(run.steps, run.direction) for run in found] == [(24, 1), (6, -1)]
    find_runs(bench.t[kept][::5], bench.x[kept][::5], 1.0 / 400.0)


@pytest.mark.parametrize(("frequency", "swings"), [(4000.0, 8.0), (700.0, 3.5)])
def test_what_follows_a_slip_is_the_mean_of_the_settled_cycles(
    frequency: float, swings: float
) -> None:
    """From a swing before the slip (a fifth of a period at most) to eight after, or half a period.

    The first six of ten cycles are left out; of these, three differ.
    """
    period, ringing = 0.01, Ringing(frequency, 500.0)
    t: np.ndarray = np.arange(0.0, 0.11, 1e-5)
    slips = period * np.arange(1.0, 11.0)
    x = np.zeros_like(t)
    for number, slip in enumerate(slips):
        since = np.maximum(t - slip, 0.0)
        swing = 1.0 - ringing.columns(since) @ [1.0, 0.0]
        x -= (9e-8 if number < 3 else 3e-8) * (t > slip) * swing
    run = replace(analyse_cycles(t, x, None, Cycles.even(slips, period, -1)), ringing=ringing)
    since, place = after_slip(t, x, run)
    assert since[0] == pytest.approx(-1.0 / frequency)
    assert since[-1] == pytest.approx(swings / frequency if swings == 8.0 else 0.5 * period)
    expected = 3e-8 * (since > 0.0) * (1.0 - ringing.columns(np.maximum(since, 0.0)) @ [1.0, 0.0])
    assert place == pytest.approx(expected, abs=1e-9)
    shorter = [replace(run, cycles=Cycles.even(slips[:k], period, -1)) for k in (4, 9)]
    assert main_run([shorter[0], run, shorter[1]]) is run
    assert len(after_slip(t[::200], x[::200], run)[0]) == 0


def test_spikes_gaps_hum_and_drift_hide_no_step() -> None:
    sensor = Sensor(
        rate=200e3, noise=4e-9, quantum=1e-9, hum=8e-9, drift=1e-7, spikes=8, dropouts=2, jitter=0.5
    )
    drives = (Drive(14, 400.0, pause=0.008), Drive(11, 400.0, direction=-1, pause=0.007))
    bench = bench_trace(Axis(), drives, sensor, rest=0.008)
    found = [(run.steps, run.direction) for run in find_runs(bench.t, bench.x, 1.0 / 400.0)]
    assert found == [(14, 1), (11, -1)]


@pytest.mark.parametrize(
    "frequency",
    [5000.0, *(pytest.param(one, marks=pytest.mark.long) for one in (1900.0, 2500.0, 3500.0))],
)
def test_ringing_is_not_taken_for_cycles(frequency: float) -> None:
    """Ringing of 7.5 kHz made half, twice or three times the frequency, and cycles too many."""
    drives = (Drive(20, frequency, pause=0.004), Drive(12, frequency, direction=-1, pause=0.005))
    bench = bench_trace(Axis(), drives, Sensor(rate=500e3, noise=2e-9), rest=0.005)
    found = find_runs(bench.t, bench.x)
    assert [(run.steps, run.direction) for run in found] == [(20, 1), (12, -1)]
    for run, true in zip(found, bench.runs, strict=True):
        assert run.frequency == pytest.approx(frequency, rel=2e-3)
        assert abs(run.start - true.start) * frequency < 0.3


@pytest.mark.parametrize(
    ("seed", "known"),
    [
        (6012, True),
        (7025, False),
        *(pytest.param(seed, False, marks=pytest.mark.long) for seed in (6002, 7017)),
    ],
)
def test_several_runs_at_a_part_of_the_ringing_frequency(seed: int, known: bool) -> None:
    """Three runs were taken for three or four steps of the period at which they follow each other.

    In the last one, ringing in step with the drive leaves the second cycle without a fall.
    """
    bench = random_bench(seed)
    found = find_runs(bench.t, bench.x, 1.0 / bench.drives[0].frequency if known else None)
    expected = [(run.steps, run.direction) for run in bench.runs]
    assert [(run.steps, run.direction) for run in found] == expected


def test_a_trace_without_noise_is_explained() -> None:
    """The clock of the slips stayed a period of the ringing off, and the runs were a guess."""
    drives = (Drive(14, 400.0, pause=0.008), Drive(11, 400.0, direction=-1, pause=0.007))
    bench = bench_trace(Axis(), drives, Sensor(rate=200e3, noise=0.0), rest=0.008)
    found = find_runs(bench.t, bench.x)
    assert [(run.steps, run.direction) for run in found] == [(14, 1), (11, -1)]
    for run, true in zip(found, bench.runs, strict=True):
        assert run.explained
        assert run.step_size == pytest.approx(true.step_size, abs=5e-12)


@pytest.mark.parametrize(
    ("pause", "direction", "cycles"),
    [
        (0.02, -1, 150),
        *(pytest.param(*one, 400, marks=pytest.mark.long) for one in product((0.0, 0.02), (1, -1))),
    ],
)
def test_a_long_run_begins_and_ends_where_it_does(
    pause: float, direction: int, cycles: int
) -> None:
    """Of more than 40 cycles, the first and the last are looked at; 19 or 95 were lost there."""
    drives = (Drive(cycles, 200.0, direction=direction, pause=pause),)
    bench = bench_trace(Axis(), drives, Sensor(rate=25e3, noise=1e-9), rest=0.02)
    (run,), (true,) = find_runs(bench.t, bench.x), bench.runs
    assert (run.steps, run.direction) == (cycles, direction)
    assert run.frequency == pytest.approx(200.0, rel=4e-4 / cycles)
    assert run.start == pytest.approx(true.start, abs=1e-5)
    assert run.end == pytest.approx(true.end, abs=1e-5)


def test_a_record_that_ends_within_a_cycle_holds_all_slips_before() -> None:
    """The rise after the last slip took from that before it, which was then no cycle."""
    bench = bench_trace(Axis(), (Drive(17, 730.0, pause=0.004),), Sensor(rate=5e4, noise=1e-9), 0.0)
    kept = bench.t < bench.runs[0].end - 2.7 / 730.0
    (run,) = find_runs(bench.t[kept], bench.x[kept])
    assert (run.steps, run.doubts) == (14, ())


def test_many_cycles_forth_and_back_are_no_long_cycle() -> None:
    """The falls of the whole way back were higher than all slips: 12 steps of 0.26 s were seen."""
    drives = (Drive(300, 1000.0, pause=0.01), Drive(150, 1000.0, direction=-1, pause=0.01))
    sensor = Sensor(rate=200e3, noise=2e-9, hum=5e-9, drift=1e-8)
    bench = bench_trace(Axis(), drives, sensor, rest=0.02, seed=1)
    found = [(run.steps, run.direction) for run in find_runs(bench.t, bench.x)]
    assert found == [(300, 1), (150, -1)]


def test_hum_makes_no_longer_cycles() -> None:
    """With hum of 50 Hz, every fourth cycle of 200 Hz is alike: four steps of 50 Hz were seen."""
    drives = (Drive(15, 200.0, pause=0.02), Drive(12, 200.0, direction=-1, pause=0.02))
    sensor = Sensor(rate=200e3, noise=2e-9, hum=5e-9, drift=1e-7)
    bench = bench_trace(Axis(), drives, sensor, rest=0.02, seed=3)
    stages: list[str] = []
    found = find_steps(bench.t, bench.x, report=stages.append).runs
    assert [(run.steps, run.direction) for run in found] == [(15, 1), (12, -1)]
    assert len(stages) == STAGES
    assert (stages[0], stages[-1]) == ("falls", "steps")


@pytest.mark.parametrize(
    "motion",
    [
        0.0 * T,
        2e-8 * np.sin(2.0 * np.pi * 50.0 * T) + 8e-9 * np.sin(2.0 * np.pi * 100.0 * T + 1.0),
        5e-7 * T,
        1e-6 * np.abs((T / 0.05) % 2.0 - 1.0),
        1e-7 * np.sin(2.0 * np.pi * 333.0 * T),
    ],
    ids=["standing", "hum", "drift", "scan", "sine"],
)
def test_where_nothing_steps_no_steps_are_seen(motion: np.ndarray) -> None:
    for seed in range(1):
        noise = NOISE * np.random.default_rng(seed).standard_normal(len(T))
        assert find_runs(T, motion + noise) == []
