# SPDX-License-Identifier: Apache-2.0
"""Cycles and ringing of motions that are written down: where each begins, and what repeats."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from stickslip_ros.traces import TraceError
from stickslip_ros.traces.cycles import (
    _averaged,
    _difference_after,
    _direction_of,
    _even,
    _even_grid,
    _mean_cycle,
    _period_of,
    _repeating,
    _roughness,
    _strokes,
    find_cycles,
)
from stickslip_ros.traces.ringing import Ringing, fit_ringing

Array = NDArray[np.float64]
PERIOD, SLIP = 0.01, 2e-4  # s
T = np.arange(0.0, 0.0801, 1e-5)


def _actuator(t: Array, cycles: int = 8) -> Array:
    """Deflection of 100 nm: rises to a slip at the end of each cycle, then rests at 0."""
    knots = [(k + part) * PERIOD for k in range(cycles) for part in (0.0, 1.0 - SLIP / PERIOD)]
    levels = [0.0, 1e-7] * cycles
    return np.interp(t, [*knots, cycles * PERIOD], [*levels, 0.0])


def test_slips_of_an_actuator_begin_and_end_where_they_do() -> None:
    slips, ends = PERIOD * np.arange(1, 9) - SLIP, PERIOD * np.arange(1, 9)
    for sign in (1, -1):
        found = find_cycles(T, T, sign * _actuator(T), None, None)
        assert found.direction == sign
        assert found.period == pytest.approx(PERIOD, rel=1e-6)
        assert found.slips == pytest.approx(slips, abs=2e-6)
        assert found.ends == pytest.approx(ends, abs=2e-6)
        assert found.starts == pytest.approx(ends - PERIOD, abs=2e-6)
    given = find_cycles(T, T, _actuator(T), 100.2, 0.02)
    assert given.period == 1.0 / 100.2
    assert given.starts == pytest.approx(PERIOD * np.arange(2, 8), abs=2e-6)
    cut = find_cycles(T[370:], T[370:], _actuator(T)[370:], None, None)
    assert cut.starts == pytest.approx(PERIOD * np.arange(1, 8), abs=2e-6)
    assert cut.slips == pytest.approx(slips[1:], abs=2e-6)


def test_one_slip_needs_the_frequency_or_the_start() -> None:
    t, u = T[100:1301], _actuator(T, 1)[100:1301]
    with pytest.raises(TraceError, match="only one slip and so no period; give the drive freq"):
        find_cycles(t, t, u, None, None)
    with pytest.raises(TraceError, match="makes no whole cycle"):
        find_cycles(t[:500], t[:500], u[:500], None, None)
    t, u = T[:1301], _actuator(T, 1)[:1301]
    assert find_cycles(t, t, u, 100.0, None).starts == pytest.approx([0.0], abs=2e-6)
    found = find_cycles(t, t, u, None, 0.002)
    assert found.starts == pytest.approx([0.002])
    assert found.period == pytest.approx(0.008, abs=2e-6)


@pytest.mark.parametrize("frequency", [98.9, 101.1])
def test_a_frequency_that_the_slips_do_not_have_is_refused(frequency: float) -> None:
    with pytest.raises(TraceError, match=f"a frequency of {frequency:g} Hz would make that"):
        find_cycles(T, T, _actuator(T), frequency, None)


def test_strokes_pass_both_levels_and_noise_makes_none() -> None:
    t = np.array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0])
    share = np.array([0.0, 1.0, 0.7, 0.8, 0.5, 0.2, 0.3, 0.9, 0.0])
    expected = [
        (0.25, 0.75, 1.0),
        (3.0 + 0.05 / 0.3, 4.0 + 0.25 / 0.3, -1.0),
        (5.5, 6.75, 1.0),
        (7.0 + 0.15 / 0.9, 7.0 + 0.65 / 0.9, -1.0),
    ]
    assert _strokes(t, share) == pytest.approx(np.array(expected))


def test_slips_that_are_even_but_for_the_samples_are_made_so() -> None:
    middle = 1.0 + 0.5 * np.arange(6)
    off = np.array([0.01, -0.01, 0.0, 0.01, 0.0, -0.01])
    slips = np.column_stack([middle + off - 0.1, middle + off + 0.1])
    found, apart = _even(slips, 0.05)
    assert apart == pytest.approx(0.5, abs=0.005)
    assert found.mean(axis=1) == pytest.approx(found[0].mean() + apart * np.arange(6))
    assert np.diff(found, axis=1)[:, 0] == pytest.approx(0.2)
    unlike, apart = _even(slips, 0.001)
    assert unlike is slips
    assert apart == pytest.approx(np.median(np.diff(middle + off)))
    alone, apart = _even(slips[:1], 0.05)
    assert len(alone) == 1
    assert math.isnan(apart)


def test_a_runner_that_gets_nowhere_goes_against_its_fastest_moves() -> None:
    t = np.linspace(0.0, 3.0, 3001)
    assert (_direction_of(t, t), _direction_of(t, -t)) == (1, -1)
    sawtooth = t % 1.0  # falls in one sample each time
    sawtooth[-1] = 0.005
    assert _direction_of(t, sawtooth) == 1
    assert _direction_of(t, -sawtooth) == -1
    ahead = np.sin(20.0 * t) + 0.5 * t  # swings far, and gets ahead
    assert (_direction_of(t, ahead), _direction_of(t, -ahead)) == (1, -1)


def test_the_difference_after_a_delay_is_a_variance() -> None:
    x = np.cumsum(np.random.default_rng(5).standard_normal(300))
    x -= x.mean()
    found = _difference_after(x, 150)
    assert found[1:] == pytest.approx([np.var(x[n:] - x[:-n]) for n in range(1, 151)])
    assert found[0] == pytest.approx(0.0, abs=1e-9)


def test_a_delay_comes_from_its_multiples() -> None:
    """Of delays in whole samples, the tenth multiple tells tenths of one."""
    lags = np.arange(700.0)
    period = 61.37
    differing = np.sin(np.pi * lags / period) ** 2
    assert _repeating(differing, 60, 0.05) == pytest.approx(period, abs=0.1)
    ringing = differing + np.minimum(lags / 300.0, 1.0)  # does not last
    assert _repeating(ringing, 60, 0.25) is None


@pytest.mark.parametrize("period", [0.00917, 0.0213])
def test_the_period_is_that_of_the_motion(period: float) -> None:
    t: Array = np.arange(0.0, 0.2, 2e-5)
    x: Array = t / period + 0.3 * (t / period % 1.0)
    assert _period_of(t, x) == pytest.approx(period, rel=1e-3)
    resting = np.concatenate((np.zeros(2000), x, np.full(3000, x[-1])))
    assert _period_of(2e-5 * np.arange(float(len(resting))), resting) == pytest.approx(
        period, rel=2e-3
    )
    with pytest.raises(TraceError, match="no steps to find the period"):
        _period_of(t, np.where(t > 0.1, 1.0, 0.0))


def test_samples_are_put_on_a_grid_or_averaged_over_it() -> None:
    random = np.random.default_rng(6)
    t = np.sort(random.uniform(0.0, 2.0, 500))
    x, tick = _even_grid(t, 3.0 * t, 41)
    assert tick == pytest.approx((t[-1] - t[0]) / 40)
    assert x == pytest.approx(3.0 * np.linspace(t[0], t[-1], 41))
    means, span = _averaged(t, t**2, 10)
    edges = np.linspace(t[0], t[-1], 11)
    exact = np.diff(edges**3) / 3.0 / np.diff(edges)
    assert span == pytest.approx(np.diff(edges)[0])
    assert np.diff(means) == pytest.approx(np.diff(exact), abs=1e-3)


def test_the_mean_cycle_holds_what_repeats_without_the_trend() -> None:
    t = np.arange(0.0, 0.5, 1e-4)
    wave = np.sin(2.0 * np.pi * t / 0.02) + 0.3 * np.sin(4.0 * np.pi * t / 0.02)
    found = _mean_cycle(t, wave + 40.0 * t + 2.0, 0.02)
    phase = (np.arange(200) + 0.5) / 200
    expected = np.sin(2.0 * np.pi * phase) + 0.3 * np.sin(4.0 * np.pi * phase)
    assert len(found) == 200
    assert found == pytest.approx(expected, abs=0.05)


@pytest.mark.parametrize("degree", [1, 2])
def test_what_a_trend_with_ringing_leaves_is_rough(degree: int) -> None:
    t = np.linspace(0.0, 3e-3, 200)
    ringing = Ringing(4000.0, 500.0)
    smooth = 1.0 + 3e2 * t + (degree - 1) * 1e5 * t**2
    rings = smooth + ringing.columns(t) @ [0.3, -0.2]
    assert _roughness(smooth, t, None, degree) == pytest.approx(0.0, abs=1e-18)
    assert _roughness(rings, t, ringing, degree) == pytest.approx(0.0, abs=1e-18)
    bent = t**3 / t[-1] ** 3
    left = bent - np.polyval(np.polyfit(t, bent, degree), t)
    assert _roughness(smooth + bent, t, None, degree) == pytest.approx(left @ left, rel=1e-6)
    assert _roughness(rings, t, None, degree) > 1e-2


@pytest.mark.parametrize(
    ("frequency", "decay"), [(7500.0, 600.0), (2200.0, 40.0), (5000.0, 6000.0)]
)
def test_ringing_that_is_written_down_is_found(frequency: float, decay: float) -> None:
    """Uneven samples, a trend of its own in every window, noise of a hundredth."""
    random, true = np.random.default_rng(8), Ringing(frequency, decay)
    windows = []
    for _ in range(6):
        t = np.sort(random.uniform(0.0, 4e-3, 900))
        t -= t[0]
        swing = true.columns(t) @ random.standard_normal(2)
        trend = np.polynomial.Polynomial(random.standard_normal(3) * [1.0, 3e2, 3e4])(t)
        windows.append((t, swing + trend + 0.005 * random.standard_normal(len(t))))
    found = fit_ringing(windows)
    assert found is not None
    assert found.frequency == pytest.approx(frequency, rel=3e-3)
    assert found.decay == pytest.approx(decay, rel=0.05)
    assert fit_ringing([(t, 0.3 * random.standard_normal(len(t))) for t, _ in windows]) is None
    assert fit_ringing([]) is None


def test_the_damping_ratio_is_that_of_an_oscillator() -> None:
    """Of x'' + 2 d omega x' + omega^2 x = 0, which rings at omega sqrt(1 - d^2)."""
    omega, ratio = 3e4, 0.2
    ringing = Ringing(omega * math.sqrt(1.0 - ratio**2) / (2.0 * math.pi), ratio * omega)
    assert ringing.damping_ratio == pytest.approx(ratio)


def test_what_is_damped_out_is_no_ringing() -> None:
    t = np.linspace(0.0, 3e-3, 600)
    for ratio, rings in ((0.15, True), (0.5, False)):
        ringing = Ringing(2000.0, 2.0 * math.pi * 2000.0 * ratio / math.sqrt(1.0 - ratio**2))
        x = ringing.columns(t) @ [1.0, 0.5] + 1e-3 * np.random.default_rng(2).standard_normal(600)
        assert (fit_ringing([(t, x)]) is not None) is rings
