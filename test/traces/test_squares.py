# SPDX-License-Identifier: Apache-2.0
"""What runs leave of a motion, and that the true ones leave least."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bench_traces import Axis, Bench, Drive, Sensor, bench_trace

from stickslip_ros.traces.analysis import find_runs
from stickslip_ros.traces.even_samples import EvenSamples, SlipGrid, resample_evenly
from stickslip_ros.traces.squares import Squares


@pytest.fixture(scope="module")
def bench() -> Bench:
    """Twenty-four cycles at 200 Hz and twelve back, with hum."""
    drives = (Drive(24, 200.0, pause=0.02), Drive(12, 200.0, direction=-1, pause=0.02))
    return bench_trace(Axis(), drives, Sensor(rate=1e5, noise=1e-9, hum=5e-9), rest=0.02, seed=4)


@pytest.fixture(scope="module")
def even(bench: Bench) -> EvenSamples:
    return resample_evenly(bench.t, bench.x, 2**20)


def _grid(bench: Bench, run: int, period: float = 1.0) -> SlipGrid:
    """A true run, with a part or a multiple of its period."""
    true = bench.runs[run]
    every = period / true.frequency
    return SlipGrid(true.start + every, every, round(true.steps / period), true.direction, 1e-7, 0)


def test_each_true_run_leaves_less(bench: Bench, even: EvenSamples) -> None:
    squares, both = Squares(even), [_grid(bench, 0), _grid(bench, 1)]
    left = [squares.left(runs) for runs in ([], both[:1], both)]
    assert left[0] > left[1] + 0.5 and left[1] > left[2] + 0.5
    assert squares.left(both[::-1]) == pytest.approx(left[2])


@pytest.mark.parametrize("period", [1.0 / 3.0, 0.5, 1.31, 2.0, 3.0])
def test_the_true_period_leaves_least(bench: Bench, even: EvenSamples, period: float) -> None:
    """A multiple repeats as well, but fewer cycles tell each of them."""
    squares = Squares(even)
    assert squares.left([_grid(bench, 0)]) < squares.left([_grid(bench, 0, period)])


@pytest.mark.slow
def test_the_ends_of_a_run_are_found(bench: Bench, even: EvenSamples) -> None:
    squares, true, other = Squares(even), _grid(bench, 0), _grid(bench, 1)
    for early, late in ((2, 0), (0, -2), (-1, 1), (1, -2), (-2, 0)):
        off = replace(true, first=true.first + early * true.period, count=true.count + late - early)
        found = squares.settle_ends(off, [other])
        assert found.count == true.count
        assert found.first == pytest.approx(true.first)


def test_gaps_and_long_records_are_no_matter(bench: Bench) -> None:
    rng = np.random.default_rng(2)
    kept = np.ones(len(bench.t), dtype=bool)
    for first in rng.integers(0, len(bench.t), 5):
        kept[first : first + 40] = False
    gaps = resample_evenly(bench.t[kept], bench.x[kept], 2**20)
    assert not gaps.known.all()
    t = np.linspace(bench.t[0], bench.t[-1], 10 * len(bench.t))
    long = resample_evenly(t, np.interp(t, bench.t, bench.x), 2**20)
    for even in (gaps, long):
        squares = Squares(even)
        assert squares.left([_grid(bench, 0)]) < squares.left([_grid(bench, 0, 2.0)])
        assert squares.left([_grid(bench, 0)]) < squares.left([]) - 0.5


def test_a_run_of_noise_is_chance(bench: Bench, even: EvenSamples) -> None:
    """A ramp with noise is explained by cycles of any period, but none has a shape."""
    assert Squares(even).repeats(_grid(bench, 0)) > 100.0
    rng, drift = np.random.default_rng(5), 2e-5 * bench.t
    ramp = resample_evenly(bench.t, drift + 1e-8 * rng.standard_normal(len(bench.t)), 2**20)
    for period in (0.5, 1.0, 1.31, 3.0):
        assert Squares(ramp).repeats(_grid(bench, 0, period)) < 0.0


@pytest.mark.slow
def test_more_cycles_than_a_long_record_is_looked_at_are_no_chance() -> None:
    """20 000 true cycles were dropped as noise: averaged, the record showed none of them."""
    bench = bench_trace(Axis(), (Drive(3000, 1e3, pause=0.02),), Sensor(2e4, noise=1e-9), 0.02, 1)
    squares, grid = Squares(resample_evenly(bench.t, bench.x, 2**20)), _grid(bench, 0)
    assert not squares.resolves(grid)
    assert squares.repeats(grid) > 100.0
    assert squares.settle_ends(grid, []) == grid
    short = replace(grid, period=2e-4, count=2)  # of fewer samples than tell anything
    assert squares.repeats(replace(short, period=5e-5)) == np.inf
    assert not np.isnan(squares.repeats(short))


@pytest.mark.slow
def test_few_samples_of_many_cycles_tell_a_ringing_between_them() -> None:
    """The ringing has two thirds of a sample a swing: neighbouring cycles have little in common."""
    (drive,) = drives = (Drive(60, 370.0, direction=-1, amplitude=200.0, pause=0.01),)
    axis = Axis(sigma_1=6.0, mass=3.5e-3)
    bench = bench_trace(axis, drives, Sensor(11.3 * 370.0, noise=1e-9), rest=0.01, seed=3)
    even, grid = resample_evenly(bench.t, bench.x, 2**20), _grid(bench, 0)
    squares = Squares(even)
    assert even.tick * axis.ringing[0] > 1.4
    assert squares.explains(grid)
    off = grid.about_middle(grid.period * (1.0 + 0.02 / grid.count))
    assert not squares.explains(off)
    assert squares.tune(off).period == pytest.approx(grid.period, rel=1e-3 / grid.count)
    for period in (None, grid.period):
        (run,) = find_runs(bench.t, bench.x, period)
        assert (run.steps, run.direction) == (drive.cycles, -1)
        assert run.doubts in ((), ("59 or 60 steps",))
        true = bench.runs[0].step_size
        assert run.step_size == pytest.approx(true, abs=3.0 * run.step_size_error)
