# SPDX-License-Identifier: Apache-2.0
"""Bins, hum and colour of the noise."""

from dataclasses import replace

import numpy as np
import pytest
from experiments import small
from scipy.signal import lfilter

from stickslip_ros.identification.experiment import Experiment, Stepping
from stickslip_ros.identification.noise import (
    Hum,
    Noise,
    autocorrelation,
    coloured,
    learn,
    whitener,
)
from stickslip_ros.identification.trace_fit import BinnedModel, Bins, TraceFit
from stickslip_ros.measurement.steps.hum import MAINS, USUAL, hum_columns
from stickslip_ros.measurement.steps.ringing import Ringing
from stickslip_ros.motion.motion import Motion
from stickslip_ros.parameters import Parameters


def hum_in(t: np.ndarray, left: np.ndarray) -> tuple[float, ...]:
    """The mains of hum in residuals."""
    return learn(t, left, np.ones_like(t))[1]


@pytest.mark.slow
def test_a_bin_sees_of_the_model_what_it_holds_of_the_samples() -> None:
    """A bin is as wide as a twelfth of the ringing: its middle alone would be 1 % off."""
    known, motion = small()[1]
    experiment = Experiment.of(known, motion)
    bins = Bins.of(experiment)
    assert experiment.ringing is not None
    angle = 2.0 * np.pi * experiment.ringing.frequency
    edges = np.searchsorted(motion.t, bins.t[0] - 1e-9)
    assert edges <= len(motion.t)
    exact = np.empty(len(bins.t))
    at = 0
    for k, count in enumerate(bins.count.astype(int)):
        exact[k] = np.cos(angle * motion.t[at : at + count]).mean()
        at += count
    assert at == len(motion.t)
    seen = bins.means(np.cos(angle * bins.nodes))
    plain = np.cos(angle * bins.t)
    assert np.abs(seen - exact).max() < 2e-3
    assert np.sqrt(np.mean((seen - exact) ** 2)) < 0.1 * np.sqrt(np.mean((plain - exact) ** 2))


@pytest.mark.slow
def test_some_bins_keep_their_own_instants() -> None:
    bins = Bins.of(Experiment.of(*small()[1]))
    kept = np.arange(len(bins.t)) % 3 == 0
    some = bins.some(kept, len(kept))
    assert some.means(some.nodes) == pytest.approx(bins.means(bins.nodes)[kept], abs=1e-12)


def test_bins_are_fine_where_the_waveform_slips() -> None:
    """All waveforms were taken for a sawtooth, which slips at the end of its cycle."""
    t = np.arange(0.0, 0.05, 2e-6)
    motion = Motion("bench", t, np.sin(t))
    for drive, slip in (
        ({}, (9.7e-3, 10e-3)),
        ({"waveform": "hold", "hold_after": 0.3}, (6.7e-3, 7e-3)),
        ({"waveform": "triangle"}, (5e-3, 10e-3)),
    ):
        known = Parameters.of({"frequency": 100.0, "amplitude": 300.0, "slewrate": 1.0, **drive})
        bins = Bins.of(Experiment(known, motion, (Stepping(0.0, 5, 100.0),), Ringing(5e3, 500.0)))
        place = np.mod(bins.t, 0.01)
        slips = (place > slip[0]) & (place < slip[1]) & (bins.t < 0.045)
        fine = np.bincount(bins.owner) > 2
        assert fine[slips].all()
        assert fine.mean() == pytest.approx((slip[1] - slip[0]) / 0.01, abs=0.02)


def test_the_colour_of_noise_is_found() -> None:
    white = 2e-9 * np.random.default_rng(4).standard_normal(20_000)
    for colour in (0.0, 0.5, 0.9):
        noise = coloured(lfilter([1.0], [1.0, -colour], white))
        assert noise.size == pytest.approx(2e-9, rel=0.02)
        own = [*noise.filter, 0.0]
        assert own[:2] == pytest.approx([1.0, -colour], abs=0.03)


@pytest.mark.slow
def test_a_wander_is_made_white() -> None:
    """Its first orders alone left the slow part, which moved sigma_0ss by six deviations."""
    random, count = np.random.default_rng(5), 6000
    t, white = 2e-5 * np.arange(count, dtype=np.float64), 1e-9 * random.standard_normal(count)
    for walk in (0.0, 3e-11, 1e-9):
        left = white + walk * np.cumsum(random.standard_normal(count)) + 3e-7 + 1e-6 * t
        noise, mains = learn(t, left, np.ones(count))
        assert mains == ()
        assert noise.structure < 1.05
        columns = noise.whitened(np.column_stack([np.ones(count), t, left]), np.ones(count))
        basis, _ = np.linalg.qr(columns[:, :2])
        rest = columns[:, 2] - basis @ (basis.T @ columns[:, 2])
        for length in (1, 20, 200):  # as white over long times as over short ones
            means = rest.reshape(-1, length).mean(axis=1)
            assert np.std(means) * np.sqrt(length) == pytest.approx(1.0, rel=0.35)


def test_the_filter_of_a_walk_with_white_noise_is_known() -> None:
    """Their sum is a moving average of first order, summed: 1 - L over 1 - theta L."""
    walk = 0.02  # of the samples: where the power of the walk is that of the white noise
    ratio = (2.0 * np.pi * walk) ** 2  # of the variances
    theta = 1.0 + 0.5 * ratio - np.sqrt(ratio + 0.25 * ratio**2)
    taps = lfilter([1.0, -1.0], [1.0, -theta], np.eye(1, 2000)[0])
    assert whitener(2000, 0.0, walk) == pytest.approx(taps, abs=2e-3)


def test_a_spike_is_bridged() -> None:
    noise, kept = Noise(1.0, whitener(100, 0.0, 0.5)), np.ones(100)
    kept[50] = 0.0
    x = np.linspace(3.0, 4.0, 100)
    spiked = x.copy()
    spiked[50] = 1e3
    white = noise.whitened(np.column_stack([x, spiked]), kept)
    assert white[:, 0] == pytest.approx(white[:, 1])
    assert white[50].tolist() == [0.0, 0.0]


def test_bins_of_nine_and_ten_samples_scale_a_wander_alike() -> None:
    t = np.arange(0.0, 1.0, 1e-3)
    bins = Bins(t, t, np.resize([9.0, 10.0], 1000), t, np.arange(1000), t, 1e-9)
    assert bins.scale == pytest.approx(3.0, abs=0.2)
    assert bins.whole.all()


@pytest.mark.slow
def test_hum_is_found() -> None:
    t = np.arange(0.0, 0.13, 2e-5)
    noise = 1e-9 * np.random.default_rng(7).standard_normal(len(t))
    for mains in (50.0, 60.0):
        left = noise + 5e-10 * np.sin(2.0 * np.pi * mains * t + 1.0)
        assert hum_in(t, left) == (mains,)


def test_hum_of_which_a_short_measurement_shows_one_period_is_taken_out_whole() -> None:
    """Over 25 ms, 60 Hz takes up most of a hum of 50 Hz, and leaves a part that repeats."""
    t = np.arange(0.0, 0.025, 2e-6)
    hum = 8e-9 * sum(
        part * np.sin(2.0 * np.pi * 50.0 * k * t + k) for k, part in ((1, 1.0), (2, 0.4), (3, 0.3))
    )
    white = 2e-9 * np.random.default_rng(8).standard_normal(len(t))
    found = hum_in(t, hum + white)
    columns = np.column_stack([np.ones_like(t), t, *hum_columns(t, found)])
    basis, _ = np.linalg.qr(columns)
    left = hum - basis @ (basis.T @ hum)
    assert np.sqrt(np.mean(left**2)) < 3e-11


@pytest.mark.slow
@pytest.mark.parametrize(("duration", "told", "off"), [(0.026, 60.0, 0.0), (0.25, 50.0, 0.05)])
def test_hum_leaves_nothing_where_its_frequency_is_told_wrongly(
    duration: float, told: float, off: float
) -> None:
    """A choice between 50 and 60 Hz, or mains off by 0.05 Hz, must not pull at the parameters."""
    _, (known, motion) = small()
    t = np.arange(0.0, duration, 2e-6)
    orders, parts = np.array([[1.0], [2.0], [3.0]]), 1.5e-8 * np.array([1.0, 0.4, 0.3])
    hum = parts @ np.sin(2.0 * np.pi * (50.0 + off) * orders * t + orders)
    fit = TraceFit(Experiment.of(known, motion))
    ones = np.ones_like(t)  # bins of one sample each
    fit.bins = Bins(t, hum, ones, t, np.arange(len(t)), ones, 1e-9)
    fit.kept, fit.noise = np.ones_like(t), Noise(1e-9, np.ones(1))
    still = BinnedModel(np.zeros_like(t), np.zeros_like(t))
    without, _ = fit.residuals(still)
    fit.hum = Hum.of(t, hum, (told,))
    left, basis = fit.residuals(still)
    assert len(left) == fit.size == len(basis)
    assert float(without @ without) > 1e5
    assert float(left @ left) < 12.0  # chance leaves 24 unknowns as much
    noise = 1e-9 * np.random.default_rng(4).standard_normal(len(t))
    noise[5000] += 5e-8
    fit.bins = replace(fit.bins, x=noise)
    fit.learn_noise(still)
    assert 5000 in np.flatnonzero(fit.kept == 0.0) and fit.kept.sum() > len(t) - 20


def test_hum_is_as_large_beforehand_as_is_usual_or_as_it_stands_out() -> None:
    t = np.arange(0.0, 0.4, 1e-3)
    hum = Hum.of(t, 1e-9 * np.cos(2.0 * np.pi * 50.0 * t), (50.0,))
    assert hum is not None
    assert hum.widths[:6] == pytest.approx(USUAL / np.array([1, 1, 2, 2, 3, 3]))
    assert Hum.of(t, np.zeros_like(t), ()) is None
    large = Hum.of(t, 1e-6 * np.cos(2.0 * np.pi * 50.0 * t), (50.0,))
    assert large is not None
    assert large.widths[0] == pytest.approx(1.5e-6, rel=0.01)


@pytest.mark.slow
def test_noise_does_not_hum() -> None:
    t = np.arange(0.0, 0.13, 2e-5)
    for seed in range(20):
        white = np.random.default_rng(seed).standard_normal(len(t))
        assert hum_in(t, lfilter([1.0], [1.0, -0.6], white)) == ()


@pytest.mark.slow
def test_hum_is_named_by_its_mains_and_taken_for_none_else() -> None:
    t = np.arange(0.0, 0.3, 1e-4)
    noise = 1e-9 * np.random.default_rng(11).standard_normal(len(t))
    fifty, sixty = (2e-9 * np.sin(2.0 * np.pi * mains * t + 1.0) for mains in (50.0, 60.0))
    assert hum_in(t, noise) == ()
    assert hum_in(t, noise + fifty) == (50.0,)
    assert hum_in(t, noise + sixty) == (60.0,)
    assert set(hum_in(t, noise + fifty + 2.0 * sixty)) == {50.0, 60.0}
    assert hum_in(t, noise + 5e-6 * t + 3e-7) == ()
    assert hum_in(t, noise + 2e-9 * np.sin(2.0 * np.pi * 150.0 * t)) == (50.0,)  # third harmonic
    walk = np.cumsum(noise)  # neighbours go together: slow changes are no hum
    assert hum_in(t, walk) == ()


def test_waves_of_hum_follow_its_frequency() -> None:
    t = np.linspace(0.2, 0.7, 500)
    left = 4e-8 * np.cos(2.0 * np.pi * 50.0 * t) + 1e-8 * np.sin(2.0 * np.pi * 100.0 * t)
    hum = Hum.of(t, left + 1e-6 * t, (50.0,))
    assert hum is not None
    assert Hum.of(t, left, ()) is None
    assert hum.middle == pytest.approx(0.45)
    assert hum.widths[[0, 1, 2, 6]] == pytest.approx([6e-8, 6e-8, 3e-8, 6e-8], rel=0.05)
    # A frequency off by 0.05 Hz changes a wave by the standard deviation of its other columns.
    columns = hum.columns(t)
    assert len(columns) == len(hum.widths) == 2 * 2 * 3 * len(MAINS)
    for k, (mains, harmonic) in enumerate((m, h) for m in MAINS for h in (1, 2, 3)):
        moved = np.cos(2.0 * np.pi * harmonic * (mains * t + 1e-4 * (t - hum.middle)))
        change = moved - columns[2 * k]
        expected = -2e-4 * np.pi * columns[12 + 2 * k + 1]
        assert change == pytest.approx(expected, abs=3e-7)
    ratio = hum.widths[12:] / hum.widths[:12]
    assert ratio == pytest.approx(2.0 * np.pi * 0.05)


def test_correlation_is_that_of_residuals_with_themselves() -> None:
    left = np.array([1.0, 2.0, -1.0, 0.5])
    power = 1.0 + 4.0 + 1.0 + 0.25
    expected = [1.0, (2.0 - 2.0 - 0.5) / power, (-1.0 + 1.0) / power, 0.5 / power]
    assert autocorrelation(left, 3) == pytest.approx(expected)
