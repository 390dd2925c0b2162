# SPDX-License-Identifier: Apache-2.0
"""The answers that a run is a sum of, by an integrator that shares no code with them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import scipy
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from stickslip_ros.traces.cycle_fit import (
    fit_cycles,
    responses_of,
)
from stickslip_ros.traces.even_samples import EvenSamples, SlipGrid
from stickslip_ros.traces.ringing import PUSH, Ringing

Array = NDArray[np.float64]
PERIOD = 1e-3
SLIPS: Array = np.array([0.2e-3, 1.2e-3, 2.2e-3, 3.2e-3])  # s
EDGES: Array = np.concatenate(
    (np.linspace(0.0, 5e-3, 60), [9e-3])
)  # the last cell is longer than a cycle


@pytest.mark.slow
@pytest.mark.parametrize(("frequency", "decay"), [(4100.0, 600.0), (7300.0, 2500.0)])
def test_answers_to_rises_and_drops_are_those_of_an_integrator(
    frequency: float, decay: float
) -> None:
    """x'' + 2 delta (x' - y') + omega_0^2 (x - y) = 0 under y that rises or drops by 1."""
    omega = 2.0 * math.pi * frequency
    stiffness = omega**2 + decay**2

    def means(begin: float, end: float, level: float, kick: float) -> Array:
        """Cell means of x: y is level at begin, 1 from end on; x' begins with kick."""
        rate = (1.0 - level) / (end - begin)
        state, since = np.array([0.0, kick, 0.0]), begin
        total = np.zeros(len(EDGES))  # integral of x up to each edge
        for stop, speed in ((end, rate), (EDGES[-1], 0.0)):

            def slope(t: float, now: Array, speed: float = speed) -> list[float]:
                place = level + rate * (min(t, end) - begin)
                pull = 2.0 * decay * (now[1] - speed) + stiffness * (now[0] - place)
                return [now[1], -pull, now[0]]

            options = {"method": "DOP853", "rtol": 1e-9, "atol": 1e-12, "dense_output": True}
            found = solve_ivp(slope, (since, stop), state, **options)
            total = np.where(since < EDGES, found.sol(np.clip(EDGES, since, stop))[2], total)
            state, since = found.y[:, -1], stop
        return np.diff(total) / np.diff(EDGES)

    rises, falls = responses_of(EDGES, SLIPS, PERIOD, Ringing(frequency, decay))
    assert rises.shape == falls.shape == (len(SLIPS), len(EDGES) - 1)
    for number in (1, 2, 3):
        begin, end = SLIPS[number - 1], SLIPS[number]
        assert rises[number] == pytest.approx(means(begin, end, 0.0, 0.0), abs=1e-7)
        # A drop pushes the runner through the damping, by as much as slip_onset takes it to.
        drop = means(end, end + 1e-4, 1.0, (1.0 + PUSH) * decay)
        assert falls[number] == pytest.approx(drop, abs=1e-7)


RINGING, TICK = Ringing(4100.0, 900.0), 1e-5
RISES = 1e-7 * np.array([1.0, 0.9, 1.1, 1.0, 1.05, 0.95, 1.0, 1.0])  # m
FALLS = 1e-7 * np.array([0.4, 0.5, 0.4, 0.45, 0.5, 0.4, 0.4, 0.42])


def _run(cycles: int = 8, noise: float = 1e-10, direction: int = 1) -> tuple[EvenSamples, SlipGrid]:
    """Cycles that rise and fall by RISES and FALLS, in turn, between two rests of four periods."""
    slips: Array = 5e-3 + PERIOD * np.arange(float(cycles))
    count = round((slips[-1] + 4.0 * PERIOD) / TICK)
    edges: Array = TICK * (np.arange(count + 1.0) - 0.5)
    rises, falls = responses_of(edges, slips, PERIOD, RINGING)
    turns = np.arange(cycles) % 8
    x = direction * (RISES[turns] @ rises - FALLS[turns] @ falls)
    x = x + noise * np.random.default_rng(7).standard_normal(count)
    even = EvenSamples(0.0, TICK, x + 1e-6, np.ones(count, dtype=bool), noise)
    return even, SlipGrid(float(slips[0]), PERIOD, cycles, direction, 5e-8, 1.0)


@pytest.mark.parametrize("direction", [1, -1])
def test_rises_and_falls_come_out_of_the_motion_they_make(direction: int) -> None:
    even, grid = _run(direction=direction)
    fit = fit_cycles(even, grid, RINGING, 0.0, even.end, tuned=True)
    assert fit is not None
    assert fit.number.tolist() == list(range(-2, 10))
    inside = slice(2, 10)
    assert fit.rise[inside] == pytest.approx(RISES, abs=2e-9)
    assert fit.fall[inside] == pytest.approx(FALLS, abs=2e-9)
    others = np.r_[fit.rise[:2], fit.fall[:2], fit.rise[10:], fit.fall[10:]]
    assert np.abs(others).max() < 2e-9
    assert fit.residual < 3.0 * fit.noise
    assert fit.spread == pytest.approx(np.std(even.x), rel=0.15)
    assert fit.extent() == (0, 7)
    assert fit.explains()
    assert fit.seen.all()


@pytest.mark.filterwarnings("error")
def test_no_cycles_and_no_noise_warn_nobody() -> None:
    even, grid = _run()
    fit = fit_cycles(even, grid, RINGING, 0.0, even.end, tuned=True)
    assert fit is not None
    assert replace(fit, number=fit.number + 1000).extent() == (0, -1)
    still = replace(fit, rise=0.0 * fit.rise, fall=0.0 * fit.fall, errors=0.0 * fit.errors)
    still = replace(still, residual=0.0, noise=0.0, spread=0.0)
    assert np.isfinite(still.odds).all()


@pytest.mark.slow
@pytest.mark.parametrize("late", [-0.3, 0.0, 0.2, 0.4])
def test_the_clock_and_the_ringing_are_tuned(late: float) -> None:
    """From up to four tenths of a period off, where ringing blurs the clock."""
    even, grid = _run()
    off = SlipGrid(grid.first + late * PERIOD, 1.003 * PERIOD, 8, 1, 5e-8, 1.0)
    fit = fit_cycles(even, off, Ringing(4080.0, 800.0), 0.0, even.end)
    assert fit is not None
    assert fit.grid.first == pytest.approx(grid.first, abs=2e-6)
    assert fit.grid.period == pytest.approx(PERIOD, rel=3e-4)
    assert fit.ringing.frequency == pytest.approx(RINGING.frequency, rel=2e-3)
    assert fit.ringing.decay == pytest.approx(RINGING.decay, rel=0.1)
    assert fit.explains()


def test_of_a_long_run_both_ends_are_looked_at() -> None:
    even, grid = _run(64)
    fit = fit_cycles(even, grid, RINGING, 0.0, even.end, tuned=True)
    assert fit is not None
    assert fit.number.tolist() == [*range(-2, 20), *range(45, 66)]  # the slip of 20 is not
    for part in (slice(2, 21), slice(24, 41)):
        turns = fit.number[part] % 8
        assert fit.rise[part] == pytest.approx(RISES[turns], abs=3e-9)
        assert fit.fall[part] == pytest.approx(FALLS[turns], abs=3e-9)
    assert fit.seen.all()
    assert fit.extent() == (0, 63)
    longer = SlipGrid(grid.first, PERIOD, 67, 1, 5e-8, 1.0)
    fit = fit_cycles(even, longer, RINGING, 0.0, even.end, tuned=True)
    assert fit is not None
    assert fit.extent() == (0, 63)


def test_a_cycle_is_one_by_rise_and_fall_but_a_last_one_by_its_fall_alone() -> None:
    """Ringing in step takes most of the fall of an early cycle; a drive stops within the last."""
    even, grid = _run()
    fit = fit_cycles(even, grid, RINGING, 0.0, even.end, tuned=True)
    assert fit is not None
    for at, counts in ((2, True), (3, True), (9, False)):
        fall = fit.fall.copy()
        fall[at] = 0.1 * np.median(FALLS)
        odds = replace(fit, fall=fall).odds
        assert (odds[at] > 0.0) == counts
        others = np.delete(odds, at)
        assert others[2:9].min() > 3.0
        assert others[[0, 1, 9, 10]].max() < -3.0


def test_noise_that_neighbours_share_widens_the_errors_as_much_as_it_does_the_falls() -> None:
    even, grid = _run()
    noise = np.random.default_rng(3).standard_normal(len(even.x))
    walking = scipy.signal.lfilter([3e-9], [1.0, -0.98], noise)
    fit = fit_cycles(replace(even, x=even.x + walking), grid, RINGING, 0.0, even.end, tuned=True)
    assert fit is not None
    rise, fall = (np.r_[0.0, 0.0, sizes, 0.0, 0.0] for sizes in (RISES, FALLS))
    for found, true, errors in zip((fit.rise, fit.fall), (rise, fall), fit.errors, strict=True):
        assert 0.5 < np.sqrt(np.mean(((found - true) / errors) ** 2)) < 2.0


def test_too_little_tells_nothing() -> None:
    even, grid = _run()
    assert fit_cycles(even, grid, RINGING, 0.0, 2.9e-3) is None
    dark = EvenSamples(0.0, TICK, even.x, np.zeros(len(even.x), dtype=bool), even.noise)
    assert fit_cycles(dark, grid, RINGING, 0.0, even.end) is None
