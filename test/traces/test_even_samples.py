# SPDX-License-Identifier: Apache-2.0
"""What a search is made of: even samples, cycles laid over one another, hum, noise."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from stickslip_ros.traces.even_samples import (
    EvenSamples,
    SlipGrid,
    cycles_on_grid,
    fill_gaps,
    mean_cycle,
    noise_of,
    phases_of,
    resample_evenly,
    row_means,
    sample_cycles,
    similarity,
    without_spikes,
    without_trend,
)
from stickslip_ros.traces.hum import hum_columns

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


def test_pairs_of_samples_hold_the_same_means(random: np.random.Generator) -> None:
    x, known = random.standard_normal(41), np.ones(41, dtype=bool)
    known[7] = False
    even = _even(x, known)
    half = even.halved
    assert half.x == pytest.approx([0.5 * (x[k] + x[k + 1]) for k in range(0, 40, 2)])
    assert np.flatnonzero(~half.known).tolist() == [3]
    assert half.noise == pytest.approx(even.noise / math.sqrt(2.0))
    assert (half.tick, half.end) == pytest.approx((2.0 * TICK, even.begin + 38.5 * TICK))
    pairs: Array = even.begin + TICK * (np.arange(10.0, 40.0, 2.0) - 0.5 + 1e-6)
    assert half.means(pairs) == pytest.approx(even.means(pairs), abs=1e-4)


def test_samples_between_times_count_from_the_first_of_them(random: np.random.Generator) -> None:
    even = _even(np.arange(50.0))
    times = even.begin + TICK * np.arange(50.0)
    for low, high in random.uniform(times[0] - 3 * TICK, times[-1] + 3 * TICK, (100, 2)):
        t, x = even.between(low, high)
        assert x.tolist() == np.flatnonzero((times >= low) & (times <= high)).tolist()
        assert t == pytest.approx(TICK * np.arange(len(x)))


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


def test_the_noise_of_a_long_measurement_is_that_of_all_of_it(random: np.random.Generator) -> None:
    x = random.standard_normal(5 * 2**19)
    x[2**20 :] *= 4.0
    third = np.diff(x, 3)
    expected = 1.4826 * float(np.median(np.abs(third))) / math.sqrt(20.0)
    assert noise_of(x) == pytest.approx(expected, rel=0.02)


def test_only_samples_far_off_are_spikes(random: np.random.Generator) -> None:
    """Of noise of 1, ten times that is one; five times that, and a fast rise, are not."""
    x = random.standard_normal(20_000)
    spikes = np.arange(500, 20_000, 1000)
    x[spikes] = np.where(np.arange(len(spikes)) % 2, 14.0, -14.0)
    x[spikes[:-1] + 400] = 5.0
    x[10_200:] += 100.0
    kept = without_spikes(x, noise_of(x))
    assert np.flatnonzero(~kept).tolist() == spikes.tolist()


def test_even_samples_stay_what_they_are(random: np.random.Generator) -> None:
    t = 0.75 + TICK * np.arange(2000.0)
    x = 1e-7 * np.sin(t * 300.0) + 1e-9 * random.standard_normal(2000)
    even = resample_evenly(t, x, 2000)
    assert (even.begin, even.tick, even.end) == pytest.approx((t[0], TICK, t[-1]), rel=1e-9)
    assert even.x == pytest.approx(x, abs=1e-15)
    assert even.known.all()
    assert even.noise == pytest.approx(1e-9, rel=0.2)


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


def test_a_course_counts_its_slips() -> None:
    grid = SlipGrid(first=0.2, period=0.05, count=4, direction=1, step=1e-7, score=1.0)
    assert grid.slips == pytest.approx([0.2, 0.25, 0.3, 0.35])
    assert (grid.begin, grid.end) == pytest.approx((0.15, 0.35))


@pytest.mark.parametrize(("ticks", "count"), [(3.0, 8), (50.0, 50), (1000.0, 200)])
def test_phases_go_from_a_slip_to_a_quarter_after_the_next(ticks: float, count: int) -> None:
    phases = phases_of(_even(np.zeros(10)), ticks * TICK)
    assert np.diff(phases) == pytest.approx(1.0 / count)
    assert phases[0] == pytest.approx(-1.0 + 0.5 / count)
    assert phases[-1] == pytest.approx(0.25 - 0.5 / count, abs=1.0 / count)


def test_a_line_has_its_own_places_about_the_phases() -> None:
    even = _even(5.0 * TICK * np.arange(2000.0))
    phases, slips = phases_of(even, 100 * TICK), even.begin + TICK * np.array([150.0, 612.3])
    rows = cycles_on_grid(even, slips, 100 * TICK, phases)
    times = slips[:, None] + 100 * TICK * phases - even.begin
    assert rows == pytest.approx(5.0 * times, abs=1e-9)


def test_of_many_cycles_stretches_stand_for_all() -> None:
    assert sample_cycles(320).tolist() == list(range(320))
    few = sample_cycles(10_000)
    starts = few[np.concatenate(([True], np.diff(few) > 1))]
    assert len(few) == 320
    assert starts == pytest.approx(np.linspace(0, 9984, 20), abs=1.0)
    assert few[-1] == 9999


def test_rows_are_summed_up_by_what_is_known(random: np.random.Generator) -> None:
    rows = random.standard_normal((9, 30)) + np.linspace(0.0, 8.0, 9)[:, None]
    rows[random.random(rows.shape) < 0.15] = np.nan
    assert row_means(rows) == pytest.approx(np.nanmean(rows, axis=1))
    about = np.nanmedian(rows - np.nanmean(rows, axis=1)[:, None], axis=0)
    assert mean_cycle(rows) == pytest.approx(about - about.mean())
    rows[:, 4], rows[2] = np.nan, np.nan
    assert math.isnan(row_means(rows)[2])
    known = np.delete(rows, 4, axis=1)
    others = np.nanmedian(known - row_means(rows)[:, None], axis=0)
    assert mean_cycle(rows) == pytest.approx(np.insert(others - others.mean(), 4, 0.0))
    assert (mean_cycle(rows[:0]) == 0.0).all()


def test_likeness_is_the_slope_of_a_row_over_the_mean_cycle(random: np.random.Generator) -> None:
    mean = random.standard_normal(40)
    mean -= mean.mean()
    rows = np.outer([1.0, 0.3, -0.5, 1.0, 1.0], mean) + np.array([[3.0], [0.0], [-1.0], [2.0], [0]])
    rows += 0.1 * random.standard_normal(rows.shape)
    rows[1, :10] = np.nan
    rows[3, np.argsort(mean**2)[8:]] = np.nan  # hardly anything of the mean cycle is left
    rows[4] = np.nan
    found = similarity(rows, mean)
    for k in range(3):
        known = np.isfinite(rows[k])
        assert found[k] == pytest.approx(np.polyfit(mean[known], rows[k][known], 1)[0])
    assert np.isnan(found[3:]).all()
    assert np.isnan(similarity(rows, np.zeros(40))).all()


def test_short_gaps_are_filled_and_long_ones_stay() -> None:
    rows = np.tile(np.arange(20.0), (3, 1))
    rows[0, [3, 4, 10]] = np.nan
    rows[1, 2:7] = np.nan  # a quarter
    found = fill_gaps(rows)
    assert found[0] == pytest.approx(np.arange(20.0))
    assert np.array_equal(found[1:], rows[1:], equal_nan=True)


def test_a_line_of_its_own_is_taken_out_of_each_row(random: np.random.Generator) -> None:
    phases, rows = np.sort(random.random(25)), random.standard_normal((3, 25))
    for found, row in zip(without_trend(rows, phases), rows, strict=True):
        assert found == pytest.approx(row - np.polyval(np.polyfit(phases, row, 1), phases))


def test_waves_of_hum_are_harmonics() -> None:
    t = np.linspace(0.2, 0.7, 500)
    waves = hum_columns(t, (60.0,), 3)
    angles = 2.0 * np.pi * 60.0 * t
    for k in (1, 2, 3):
        assert waves[2 * k - 2] == pytest.approx(np.cos(k * angles), abs=1e-9)
        assert waves[2 * k - 1] == pytest.approx(np.sin(k * angles), abs=1e-9)
