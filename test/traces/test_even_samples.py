# SPDX-License-Identifier: Apache-2.0
"""What a search is made of: even samples, cycles laid over one another, hum, noise."""

from __future__ import annotations

import math

import numpy as np
import pytest
from bench_traces import Axis, Drive, Sensor, bench_trace
from numpy.typing import NDArray

from stickslip_ros.traces.analysis import find_runs
from stickslip_ros.traces.even_samples import (
    EvenSamples,
    noise_of,
    quantum_of,
    resample_evenly,
    rounding_of,
    without_spikes,
)

Array = NDArray[np.float64]
TICK = 2.0**-16  # s; times are exact


@pytest.fixture
def random() -> np.random.Generator:
    return np.random.default_rng(11)


def _even(x: Array, known: NDArray[np.bool_] | None = None) -> EvenSamples:
    known = np.ones(len(x), dtype=bool) if known is None else known
    return EvenSamples(begin=0.3, tick=TICK, x=x, known=known, noise=1e-9)


def test_a_mean_between_times_is_the_area_under_the_samples(random: np.random.Generator) -> None:
    """Each sample stands for half a tick before and after it; what is not known is nan."""
    x, known = 1e-7 * random.standard_normal(60), np.ones(60, dtype=bool)
    known[[20, 21, 45]] = False
    even = _even(x, known)
    begins = even.begin + TICK * (np.arange(60) - 0.5)
    edges = np.sort(random.uniform(begins[0] - 2 * TICK, begins[-1] + 3 * TICK, (400, 2)), axis=1)
    edges[0] = begins[0] + 1e-9 * TICK, begins[-1] + (1.0 - 1e-9) * TICK  # all of it, with gaps
    edges[1] = begins[0] + 1e-9 * TICK, begins[20] - 1e-6 * TICK
    edges[2] = begins[46] + 1e-6 * TICK, begins[-1] + (1.0 - 1e-9) * TICK
    found = even.means(edges)[:, 0]
    seen = 0
    for (low, high), mean in zip(edges, found, strict=True):
        shared = np.clip(np.minimum(begins + TICK, high) - np.maximum(begins, low), 0.0, None)
        outside = low < begins[0] or high > begins[-1] + TICK
        if outside or not known[shared > 0.0].all():
            assert math.isnan(mean)
        else:
            seen += 1
            assert mean == pytest.approx(shared @ x / (high - low), rel=1e-6, abs=1e-16)
    assert seen > 60
    assert np.isfinite(found[1:3]).all()


def test_noise_is_told_from_what_is_smooth(random: np.random.Generator) -> None:
    t = np.arange(200_000)
    noise = 3e-9 * random.standard_normal(len(t))
    assert noise_of(noise + 1e-6 * np.sin(t / 300.0)) == pytest.approx(3e-9, rel=0.02)
    assert noise_of(noise[:7]) == 0.0
    assert noise_of(noise[:8]) > 0.0


def test_ringing_of_few_samples_a_swing_is_no_noise(random: np.random.Generator) -> None:
    """Third differences of three samples a swing are as large as a swing: five times the noise."""
    t = np.arange(20_000)
    swings = 2e-8 * np.exp(-(t % 2000) / 800.0) * np.sin(2.0 * np.pi * t / 3.1)
    noise = 1e-9 * random.standard_normal(len(t))
    assert noise_of(swings + noise) == pytest.approx(1e-9, rel=0.2)


def test_only_samples_far_off_are_spikes(random: np.random.Generator) -> None:
    """Of noise of 1, ten times that is one; five times that, and a fast rise, are not."""
    x = random.standard_normal(20_000)
    spikes = np.arange(500, 20_000, 1000)
    x[spikes] = np.where(np.arange(len(spikes)) % 2, 14.0, -14.0)
    x[spikes[:-1] + 400] = 5.0
    x[10_200:] += 100.0
    kept = without_spikes(x, noise_of(x))
    assert np.flatnonzero(~kept).tolist() == spikes.tolist()


def test_of_too_many_samples_neighbours_are_averaged(random: np.random.Generator) -> None:
    t = 0.75 + TICK * np.arange(4000.0)
    x = random.standard_normal(4000)
    even = resample_evenly(t, x, 500)
    assert len(even.x) == 500
    assert (even.begin, even.tick) == pytest.approx((t[:8].mean(), 8.0 * TICK))
    assert even.x == pytest.approx(x.reshape(-1, 8).mean(axis=1), abs=1e-6)
    assert even.noise == pytest.approx(1.0 / math.sqrt(8.0), rel=0.1)


def test_a_gap_is_not_known_and_a_spike_is_drawn_over(random: np.random.Generator) -> None:
    t = TICK * np.arange(3000.0)
    x = 1e-7 * np.sin(t * 300.0) + 1e-10 * random.standard_normal(3000)
    x[500] += 1e-6
    kept = (t < 1000.5 * TICK) | (t > 1005.5 * TICK)
    kept &= ~((t > 2000.5 * TICK) & (t < 2003.5 * TICK))  # four ticks long: no gap yet
    kept &= without_spikes(x, noise_of(x))
    even = resample_evenly(t[kept], x[kept], 2**21)
    unknown = np.flatnonzero(~even.known)
    assert set(range(1001, 1006)) <= set(unknown) <= set(range(1000, 1008))
    assert even.x[500] == pytest.approx(1e-7 * math.sin(t[500] * 300.0), abs=1e-9)


def test_a_trace_denser_in_places_has_a_grid_in_between() -> None:
    """Of 1100 samples, 1000 lie in a tenth of the time: 4400 places at most."""
    t = np.concatenate([np.linspace(0.0, 0.1, 1000, endpoint=False), np.linspace(0.1, 1.0, 100)])
    even = resample_evenly(t, np.sin(t), 2**21)
    assert even.tick == pytest.approx(1.0 / 4400.0)
    assert even.x == pytest.approx(np.interp(even.begin + even.tick * np.arange(len(even.x)), t,
                                             np.sin(t)), abs=1e-12)  # fmt: skip


def test_without_noise_the_digits_are_the_noise() -> None:
    t = TICK * np.arange(5000.0)
    x = 1e-9 * np.round(20.0 * np.sin(t * 60.0))
    assert resample_evenly(t, x, 2**21).noise == pytest.approx(1e-9 / math.sqrt(12.0))


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.0, 5e-10, 8e-9])
def test_a_coarse_converter_is_seen_and_counts(noise: float) -> None:
    """Steps repeat, and so does what rounding makes of them: errors were picometres."""
    drives, sensor = (Drive(16, 113.7, pause=0.03),), Sensor(rate=1e5, noise=noise, quantum=1e-8)
    bench = bench_trace(Axis(), drives, sensor, 0.04)
    assert quantum_of(bench.clean) == quantum_of(1e-9 * np.arange(99.0)) == 0.0
    assert quantum_of(bench.x) == pytest.approx(1e-8)
    one = 1e-8 / math.sqrt(12.0)
    assert noise_of(bench.x) > 0.999 * one
    shared = rounding_of(bench.x, noise_of(bench.x))
    assert shared == pytest.approx(one, rel=0.1) if noise < 5e-9 else shared < 0.5 * one
    (run,) = find_runs(bench.t, bench.x)
    assert run.backstep_error >= math.sqrt(2.0) * shared
    assert abs(run.backstep - bench.runs[0].backstep) < 2.0 * run.backstep_error
    assert abs(run.step_size - bench.runs[0].step_size) < 2.0 * run.step_size_error
