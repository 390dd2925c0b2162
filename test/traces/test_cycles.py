# SPDX-License-Identifier: Apache-2.0
"""Cycles and ringing of motions that are written down: where each begins, and what repeats."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from stickslip_ros.traces import TraceError
from stickslip_ros.traces.cycles import (
    cycles_of_actuator,
    direction_of,
    find_even,
    find_strokes,
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
        found = cycles_of_actuator(T, sign * _actuator(T))
        assert found.direction == sign
        assert found.period == pytest.approx(PERIOD, rel=1e-6)
        assert found.slips == pytest.approx(slips, abs=2e-6)
        assert found.ends == pytest.approx(ends, abs=2e-6)
        assert found.starts == pytest.approx(ends - PERIOD, abs=2e-6)
    given = cycles_of_actuator(T, _actuator(T), 100.2, 0.02)
    assert given.period == 1.0 / 100.2
    assert given.starts == pytest.approx(PERIOD * np.arange(2, 8), abs=2e-6)
    cut = cycles_of_actuator(T[370:], _actuator(T)[370:])
    assert cut.starts == pytest.approx(PERIOD * np.arange(1, 8), abs=2e-6)
    assert cut.slips == pytest.approx(slips[1:], abs=2e-6)


def test_one_slip_needs_the_frequency_or_the_start() -> None:
    t, u = T[100:1301], _actuator(T, 1)[100:1301]
    with pytest.raises(TraceError, match="only one slip and so no period; give the drive freq"):
        cycles_of_actuator(t, u)
    with pytest.raises(TraceError, match="makes no whole cycle"):
        cycles_of_actuator(t[:500], u[:500])
    t, u = T[:1301], _actuator(T, 1)[:1301]
    assert cycles_of_actuator(t, u, 100.0).starts == pytest.approx([0.0], abs=2e-6)
    found = cycles_of_actuator(t, u, None, 0.002)
    assert found.starts == pytest.approx([0.002])
    assert found.period == pytest.approx(0.008, abs=2e-6)


@pytest.mark.parametrize("frequency", [98.9, 101.1])
def test_a_frequency_that_the_slips_do_not_have_is_refused(frequency: float) -> None:
    with pytest.raises(TraceError, match=f"a frequency of {frequency:g} Hz would make that"):
        cycles_of_actuator(T, _actuator(T), frequency)


def test_strokes_pass_both_levels_and_noise_makes_none() -> None:
    t = np.array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0])
    share = np.array([0.0, 1.0, 0.7, 0.8, 0.5, 0.2, 0.3, 0.9, 0.0])
    expected = [
        (0.25, 0.75, 1.0),
        (3.0 + 0.05 / 0.3, 4.0 + 0.25 / 0.3, -1.0),
        (5.5, 6.75, 1.0),
        (7.0 + 0.15 / 0.9, 7.0 + 0.65 / 0.9, -1.0),
    ]
    assert find_strokes(t, share) == pytest.approx(np.array(expected))


def test_slips_that_are_even_but_for_the_samples_are_made_so() -> None:
    middle = 1.0 + 0.5 * np.arange(6)
    off = np.array([0.01, -0.01, 0.0, 0.01, 0.0, -0.01])
    slips = np.column_stack([middle + off - 0.1, middle + off + 0.1])
    found, apart = find_even(slips, 0.05)
    assert apart == pytest.approx(0.5, abs=0.005)
    assert found.mean(axis=1) == pytest.approx(found[0].mean() + apart * np.arange(6))
    assert np.diff(found, axis=1)[:, 0] == pytest.approx(0.2)
    dissimilarity, apart = find_even(slips, 0.001)
    assert dissimilarity is slips
    assert apart == pytest.approx(np.median(np.diff(middle + off)))
    alone, apart = find_even(slips[:1], 0.05)
    assert len(alone) == 1
    assert math.isnan(apart)


def test_a_runner_that_gets_nowhere_goes_against_its_fastest_moves() -> None:
    t = np.linspace(0.0, 3.0, 3001)
    assert (direction_of(t, t), direction_of(t, -t)) == (1, -1)
    sawtooth = t % 1.0  # falls in one sample each time
    sawtooth[-1] = 0.005
    assert direction_of(t, sawtooth) == 1
    assert direction_of(t, -sawtooth) == -1
    ahead = np.sin(20.0 * t) + 0.5 * t  # swings far, and gets ahead
    assert (direction_of(t, ahead), direction_of(t, -ahead)) == (1, -1)


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


@pytest.mark.parametrize(
    ("per_swing", "swings", "known"), [(12, 25, True), (3.5, 25, False), (12, 2.2, False)]
)
def test_the_error_of_a_decay_covers_the_sliding_before_it(
    per_swing: float, swings: float, known: bool
) -> None:
    """The first swings lose 3 % more; few samples a swing, or few swings, determine nothing."""
    frequency, decay, random = 7e3, 400.0, np.random.default_rng(5)
    t = np.arange(0.0, swings / frequency, 1.0 / (per_swing * frequency))
    lost = 1.0 + 0.03 * np.exp(-frequency * t)
    x = 1e-7 * lost * np.exp(-decay * t) * np.cos(2.0 * np.pi * frequency * t)
    found = fit_ringing([(t, x + 1e-10 * random.standard_normal(len(t))) for _ in range(12)])
    assert found is not None
    assert math.isfinite(found.decay_error) is known
    if known:
        assert abs(found.decay - decay) < 2.0 * found.decay_error < 0.1 * decay


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


@pytest.mark.slow
def test_ringing_of_slow_cycles_is_seen_in_all_of_their_first_samples() -> None:
    """Of cycles of 2 s, every second sample was taken: 7 kHz at 20 kS/s became 329 Hz."""
    t = np.arange(40_000) / 2e4
    x = 1e-7 * np.exp(-600.0 * t) * np.cos(2.0 * np.pi * 7e3 * t)
    noise = 1e-9 * np.random.default_rng(1).standard_normal(len(t))
    found = fit_ringing([(t, x + noise)] * 3)
    assert found is not None
    assert found.frequency == pytest.approx(7e3, rel=1e-3)
    assert found.decay == pytest.approx(600.0, rel=0.02)
