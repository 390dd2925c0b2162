# SPDX-License-Identifier: Apache-2.0
"""The parts of the search for runs, each on motions that are written down."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from stickslip_ros.traces import run_search
from stickslip_ros.traces.cycle_fit import CycleFit
from stickslip_ros.traces.even_samples import EvenSamples, SlipGrid
from stickslip_ros.traces.hum import hum_columns
from stickslip_ros.traces.ringing import Ringing
from stickslip_ros.traces.run_growth import (
    check_run,
    do_alternate,
    find_extent,
    find_shifts,
    fit_hum,
    fit_line,
    grow_run,
    is_no_sine,
    move_to_fall,
    refine,
    tune_period,
)
from stickslip_ros.traces.slip_edges import edge_kernel, find_edges

Array = NDArray[np.float64]
TICK, PERIOD, CYCLES, FIRST = 2e-5, 4e-3, 12, 0.0131  # s; the first slip
RISE, FALL = 1.5e-7, 5e-8  # m


def _steps(
    cycles: int = CYCLES, direction: int = 1, noise: float = 1e-9, rest: float = 5.0
) -> EvenSamples:
    """A rest, straight rises with a fall at the end of each, and a rest of so many periods."""
    t = TICK * np.arange(round((FIRST + (cycles - 1 + rest) * PERIOD) / TICK))
    since = (t - FIRST) / PERIOD + 1.0
    x = RISE * np.clip(since, 0.0, cycles) - FALL * np.clip(np.floor(since), 0.0, cycles)
    x = direction * x + noise * np.random.default_rng(3).standard_normal(len(t))
    return EvenSamples(0.0, TICK, x, np.ones(len(t), dtype=bool), noise)


def _grid(**changed: Any) -> SlipGrid:
    return replace(SlipGrid(FIRST, PERIOD, CYCLES, 1, RISE - FALL, 1.0), **changed)


@pytest.mark.parametrize("width", [2, 5, 17])
def test_an_edge_is_the_distance_of_two_lines_of_one_slope(width: int) -> None:
    """Of all weights with that property, those of least noise: half of least squares' weights."""
    place = np.arange(-width, width) + 0.5
    lines = 0.7 + 0.3 * place - 2.5 * (place > 0)
    kernel = edge_kernel(width)
    assert kernel @ lines == pytest.approx(2.5)
    design = np.column_stack([np.ones(2 * width), place, place < 0])
    assert kernel == pytest.approx(np.linalg.pinv(design)[2])


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("known", [None, PERIOD])
def test_falls_at_even_distances_are_a_chain(direction: int, known: float | None) -> None:
    even = _steps(direction=direction, noise=1e-12)
    even = replace(even, noise=2e-9)
    edges = list(find_edges(even, known))
    assert not [one for one in edges if one.direction == -direction and one.count > 11]
    found = next(one for one in edges if one.count == CYCLES)
    assert found.direction == direction
    assert found.period == pytest.approx(PERIOD, rel=1e-3)
    assert found.first == pytest.approx(FIRST, abs=2 * TICK)
    # The narrowest kernel comes first, and sees each fall whole.
    spread = 2e-9 * float(np.linalg.norm(edge_kernel(2)))
    assert found.score == pytest.approx(CYCLES * (FALL / spread) ** 2 * 11 / 13, rel=0.05)


def test_falls_that_are_clear_only_together_make_a_comb() -> None:
    """Of falls of 20 nm in noise of 8 nm, not all stand out; four of a known period do."""
    quiet = _steps(noise=0.0)
    noise = 8e-9 * np.random.default_rng(9).standard_normal(len(quiet.x))
    even = replace(quiet, x=0.4 * quiet.x + noise, noise=8e-9)
    edges = [one for one in find_edges(even, PERIOD) if one.direction == 1]
    combs = [one for one in edges if (one.period, one.count) == (PERIOD, 4)]
    best = max(combs, key=lambda one: one.score)
    off = (best.first - FIRST) / PERIOD
    assert abs(off - round(off)) * PERIOD < 10 * TICK
    assert -0.5 < off < CYCLES - 3.5
    # Without noise, four falls add up.
    even = replace(quiet, x=quiet.x + 1e-12 * noise / 8e-9, noise=2e-9)
    spread = 2e-9 * float(np.linalg.norm(edge_kernel(2)))
    combs = [one for one in find_edges(even, PERIOD) if (one.period, one.count) == (PERIOD, 4)]
    assert combs[0].score == pytest.approx(4.0 * (FALL / spread) ** 2 * 3 / 5, rel=0.05)


def test_the_line_through_most_points_is_found() -> None:
    x = np.arange(40.0)
    y = 3.0 - 0.25 * x + 0.01 * np.random.default_rng(1).uniform(-1.0, 1.0, 40)
    y[[3, 17, 30]] += [50.0, -20.0, 9.0]
    kept = np.delete(np.arange(40), [3, 17, 30])
    assert fit_line(x, y) == pytest.approx(np.polyfit(x[kept], y[kept], 1), rel=1e-6)
    assert fit_line(np.ones(3), np.array([1.0, 2.0, 3.0])) == (0.0, 2.0)


def test_a_row_that_is_late_is_shifted() -> None:
    phases = (np.arange(250) + 0.5) / 200 - 1.0
    late = np.array([0.0, 0.01, -0.02, 0.4, 0.01])
    rows = np.sin(2.0 * np.pi * (phases - late[:, None])) + np.arange(5.0)[:, None]
    rows[3] = -3.0 * np.sin(2.0 * np.pi * (phases - 0.25))  # far away: at most a tenth
    rows[4, :120] = np.nan
    found = find_shifts(rows, np.sin(2.0 * np.pi * phases), phases, 1e-3)
    assert found[:3] == pytest.approx(1e-3 * late[:3], rel=0.02, abs=1e-8)
    assert abs(found[3]) == pytest.approx(1e-4)
    assert math.isnan(found[4])
    wave = np.sin(2.0 * np.pi * phases)
    back = find_shifts(np.stack([2.0 * rows[0] - rows[3]]), wave, phases, 1e-3)
    assert back[0] == -found[3]


@pytest.mark.parametrize(
    ("like", "expected"),
    [
        ([0, 0, 1, 1, 1, 1, 0, 0], (0, 3)),
        ([0, 0.6, 1, 1, 1, 1, 0.4, 0], (-1, 3)),
        ([0, 1, 0, 1, 1, 1, 1, 0], (1, 4)),
        ([1, 1, 1, math.nan, 1, 1, 0, 0], (-2, 3)),
        ([1, 1, 1, 0, 1, 1, 1, 1], (2, 5)),
        ([1, 1, 0, 0, 0, 0, 1, 1], (0, -1)),
        ([math.nan] * 8, (0, -1)),
    ],
)
def test_a_run_goes_on_while_cycles_are_alike(like: list[float], expected: tuple[int, int]) -> None:
    assert find_extent(np.array(like, dtype=float), np.arange(-2, 6), 4) == expected


def test_the_clock_of_a_run_is_found_from_about_it() -> None:
    even = _steps()
    fallen = move_to_fall(even, _grid(first=FIRST + 0.11 * PERIOD))
    assert fallen.first == pytest.approx(FIRST, abs=1.5 * TICK)
    off = _grid(period=PERIOD * (1.0 + 0.2 / CYCLES), first=FIRST - 0.1 * PERIOD)
    assert tune_period(even, off).period == pytest.approx(PERIOD, rel=0.021 / CYCLES)
    assert tune_period(even, off).slips.mean() == pytest.approx(off.slips.mean())
    off = _grid(period=PERIOD * (1.0 + 0.04 / CYCLES))
    fine = refine(even, off)
    assert fine.period == pytest.approx(PERIOD, rel=3e-4)
    assert fine.slips.mean() == pytest.approx(off.slips.mean(), abs=TICK)


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize(("begin", "count"), [(4, 3), (0, 2), (8, 4), (-1, 14)])
def test_a_few_cycles_grow_to_the_run(direction: int, begin: int, count: int) -> None:
    even = _steps(direction=direction)
    seed = _grid(first=FIRST + begin * PERIOD, count=count, direction=direction)
    grid = grow_run(even, seed)
    assert grid is not None
    assert (grid.count, grid.direction) == (CYCLES, direction)
    assert grid.first == pytest.approx(FIRST, abs=2 * TICK)
    assert grid.period == pytest.approx(PERIOD, rel=5e-4)


def test_cycles_that_get_ahead_alike_are_steps() -> None:
    even = _steps()
    found = check_run(even, _grid(step=0.0, score=0.0))
    assert found is not None
    assert found.step == pytest.approx(RISE - FALL, rel=0.01)
    assert 0.0 <= found.dissimilarity < 0.01
    # Where the mean cycle leaves almost nothing, log(1 + 1 / 0.003) for each cycle but the first.
    exact = check_run(replace(_steps(noise=1e-13), noise=1e-9), _grid())
    assert exact is not None
    assert exact.score == pytest.approx(math.log(1.0 + 1.0 / 3e-3) * 11 * PERIOD, rel=1e-3)
    assert check_run(even, _grid(direction=-1)) is None  # does not get ahead that way


def test_what_swings_is_no_run_of_steps() -> None:
    even = _steps()
    t = TICK * np.arange(len(even.x))
    sine = 1e-7 * np.sin(2.0 * np.pi * t / PERIOD)
    for ahead in (0.0, 1.0):  # a sine, also one that goes up
        assert check_run(replace(even, x=sine + ahead * 1e-7 * t / PERIOD), _grid()) is None
    random = np.random.default_rng(4)
    assert check_run(replace(even, x=random.standard_normal(len(t)), noise=1e-9), _grid()) is None
    since = (t - FIRST) / PERIOD
    twice = even.x + np.where(since % 2.0 < 1.0, 3e-8, 0.0) * np.sin(np.pi * since) ** 2
    assert check_run(replace(even, x=twice), _grid()) is None  # now so, now so
    assert check_run(replace(even, x=twice), _grid(), given=True) is not None


def test_one_harmonic_is_a_sine_and_more_are_none() -> None:
    phase = np.arange(100) / 100
    sine, second = np.sin(2.0 * np.pi * phase), np.sin(4.0 * np.pi * phase)
    assert not is_no_sine(3.0 + sine, 0.0)
    assert not is_no_sine(sine + 0.12 * second, 0.0)
    assert is_no_sine(sine + 0.16 * second, 0.0)
    # Of errors, power comes to error^2 times samples: five times that is no chance.
    assert is_no_sine(sine + 0.5 * second, 0.4)
    assert not is_no_sine(sine + 0.5 * second, 0.6)


def test_cycles_that_take_turns_are_seen_and_chance_is_not() -> None:
    phases = (np.arange(100) + 0.5) / 100 - 1.0
    random = np.random.default_rng(12)
    wave = np.sin(2.0 * np.pi * phases)
    noise = 0.05 * random.standard_normal((12, 100))
    for apart in (2, 3, 5):
        turns = (np.arange(12) % apart == 0)[:, None] * wave
        assert do_alternate(wave + 0.5 * turns + noise, phases)
        assert not do_alternate(wave + 0.02 * turns + noise, phases)
        # Plainly so, but by less than a hundredth of the motion.
        assert not do_alternate(wave + 0.02 * turns + 0.02 * noise, phases)
    growing = np.linspace(0.0, 0.5, 12)[:, None] * wave
    assert not do_alternate(wave + growing + noise, phases)
    assert not do_alternate(wave + noise, phases)


def test_hum_is_taken_out_of_rows() -> None:
    phases = (np.arange(60) + 0.5) / 60 - 1.0
    times = 0.02 * (np.arange(15)[:, None] * 0.37 + 0.1 * phases)

    def about(rows: Array) -> Array:
        """Rows without lines of their own, and without what they share."""
        lines = np.array([np.polyval(np.polyfit(phases, row, 1), phases) for row in rows])
        return rows - lines

    hum = about(4e-9 * np.cos(100.0 * np.pi * times + 0.4) + 1e-9 * hum_columns(times, (60.0,))[3])
    cycle = about(np.tile(3e-8 * phases**2, (15, 1)))
    found = fit_hum(cycle + hum, times, phases)
    shared = (found - hum).mean(axis=0)
    assert np.ptp(hum) > 3e-10
    assert found - hum - shared == pytest.approx(np.zeros_like(hum), abs=1e-13)
    assert found.mean(axis=0) == pytest.approx(np.zeros(60), abs=1e-13)


def _cycle_fit(rise: list[float], fall: list[float], **changed: Any) -> CycleFit:
    """Two cycles before the run and two after it are looked at, too."""
    grid = _grid(count=len(rise) - 4)
    number, seen = np.arange(-2, len(rise) - 2), np.ones(len(rise), dtype=bool)
    one = CycleFit(grid, Ringing(7e3, 600.0), number, np.array(rise, dtype=float),
                np.array(fall, dtype=float), seen, 1e-9, 1e-9, 1e-7)  # fmt: skip
    return replace(one, **changed)


@pytest.mark.parametrize(
    ("rise", "fall", "expected"),
    [
        ([0, 0, 1, 1, 1, 1, 0, 0], [0, 0, 1, 1, 1, 1, 0, 0], (0, 3)),
        ([0, 1, 1, 1, 1, 1, 0, 0], [0, 1, 1, 1, 1, 1, 0, 0], (-1, 3)),
        ([0, 0.5, 1, 1, 1, 1, 0.7, 0.5], [0, 1, 1, 1, 1, 1, 1, 1], (0, 4)),
        ([0, 1, 1, 1, 1, 1, 1, 0], [0, 0.2, 1, 1, 1, 1, 0.3, 0], (0, 4)),
        ([0, 0, 1, 1, 1, 1, 0, 0], [0, 0, 1, 0, 1, 1, 0, 0], (0, 3)),  # one hole
        ([0, 0, 1, 1, 1, 1, 1, 1, 1, 0, 0], [0, 0, 1, 0, 1, 0, 1, 1, 1, 0, 0], (2, 2)),  # two
        ([0, 0, -1, -1, -1, -1, 0, 0], [0, 0, 1, 1, 1, 1, 0, 0], (0, -1)),
        ([0, 0, 1, 1, 1, 1, 0, 0], [0, 0, -1, -1, -1, -1, 0, 0], (0, -1)),
    ],
)
def test_cycles_count_that_rise_and_fall_like_most(
    rise: list[float], fall: list[float], expected: tuple[int, int]
) -> None:
    assert _cycle_fit(rise, fall).extent() == expected


def test_a_fall_that_is_not_seen_yet_counts() -> None:
    seen = np.arange(8) < 5
    assert _cycle_fit([0, 0, 1, 1, 1, 1, 0, 0], [0, 0, 1, 1, 1, 0, 0, 0], seen=seen).extent() == (
        0,
        3,
    )


def test_a_run_is_explained_by_equal_rises_and_little_else() -> None:
    ones = [1e-7] * 8
    assert _cycle_fit(ones, ones, left=3.9e-9, chance=1e-9).explains()
    assert _cycle_fit(ones, ones, left=2.4e-8, chance=1e-9).explains()  # a quarter of a fall
    assert not _cycle_fit(ones, ones, left=2.6e-8, chance=1e-9).explains()
    small = [1e-8] * 8
    assert _cycle_fit(ones, small, left=3.9e-9, chance=1e-9).explains()
    assert not _cycle_fit(ones, small, left=4.1e-9, chance=1e-9).explains()
    for off, even in ((0.3e-7, True), (0.4e-7, False)):
        uneven = [1e-7, 1e-7, *[1e-7 + off, 1e-7 - off, 1e-7] * 2, 1e-7 + off, 1e-7 - off, 0, 0]
        assert _cycle_fit(uneven, [1e-7] * 12).explains() is even


def test_where_only_every_third_cycle_falls_cycles_are_three_times_as_long() -> None:
    fall = [9.0, 9.0, *[0.1, 1.0, 0.2] * 3, 0.1, 9.0, 9.0]
    fit = _cycle_fit([1.0] * 14, fall)
    longer = fit.every(3)
    assert longer is not None
    assert longer.count == 3
    assert longer.period == pytest.approx(3.0 * PERIOD)
    assert longer.first == pytest.approx(FIRST + PERIOD)
    assert fit.every(2) is None
    assert (
        _cycle_fit([1.0] * 14, [9.0, 9.0, *[0.35, 1.0, 0.2] * 3, 0.35, 9.0, 9.0]).every(3) is None
    )


def test_runs_are_the_same_overlap_or_ring() -> None:
    """Run by run as drawn: begin and end in periods, direction."""
    one = _grid(first=1.0, period=1.0, count=10)  # from 0 to 10
    for changed, same in (
        ({}, True),
        ({"direction": -1}, False),
        ({"period": 1.029}, True),
        ({"period": 1.031}, False),
        ({"first": 10.9, "count": 3}, True),
        ({"first": 11.1, "count": 3}, False),
        ({"first": -1.1, "count": 2}, False),
    ):
        assert run_search.are_same(one, replace(one, **changed)) is same
        assert run_search.are_same(replace(one, **changed), one) is same
    for begin, overlap in ((8.9, True), (9.4, True), (9.6, False), (-2.6, False), (-2.4, True)):
        other = replace(one, first=begin + 1.0, count=3)
        assert run_search.do_overlap(one, other) is overlap
        assert run_search.do_overlap(other, one) is overlap
    for begin, rings in ((9.1, True), (11.9, True), (12.1, False), (8.9, False)):
        short = replace(one, period=0.4, first=begin + 0.4, count=3)
        assert run_search.is_ringing_of(short, one) is rings
        assert not run_search.is_ringing_of(replace(short, period=0.6, first=begin + 0.6), one)


@pytest.mark.parametrize(
    ("count", "off", "near"),
    [(5, 0.049, True), (5, 0.051, False), (50, 0.009, True), (50, -0.011, False),
     (1000, 0.0019, True), (1000, -0.0021, False)],
)  # fmt: skip
def test_a_known_period_may_be_off_by_a_clock(count: int, off: float, near: bool) -> None:
    assert (
        run_search.may_have_period(_grid(period=(1.0 + off) * PERIOD, count=count), PERIOD) is near
    )


def test_of_runs_that_overlap_the_one_that_explains_most_is_kept() -> None:
    def of(begin: float, count: int, left: float) -> CycleFit:
        grid = _grid(first=begin + PERIOD, count=count)
        return replace(_cycle_fit([1.0] * 8, [1.0] * 8), grid=grid, left=left, whole=1e-6)

    short, long, apart, good = of(0.0, 5, 1e-8), of(0.0, 9, 1e-8), of(1.0, 3, 1e-8), of(0, 6, 2e-9)
    assert run_search.weigh(long) == pytest.approx(9 * PERIOD * math.log(100.0))
    assert run_search.weigh(replace(long, chance=1e-7)) == pytest.approx(9 * PERIOD * math.log(10))
    assert run_search.choose_apart([short, apart, long], []) == [long, apart]
    assert run_search.choose_apart([short, apart, long], [good]) == [apart]
    assert run_search.choose_apart([long, of(0.0, 7, 1e-9)], [])[0].grid.count == 7
    fits = [long, of(1.0, 3, 1e-8)]
    other = replace(long, grid=replace(long.grid, period=1.2 * PERIOD))
    assert run_search.list_other_periods([*fits, other], None) == [PERIOD, 1.2 * PERIOD]
    assert run_search.list_other_periods([*fits, other], 1.2 * PERIOD) == [PERIOD]
    assert run_search.list_other_periods(fits, 1.04 * PERIOD) == []


def test_the_ringing_down_after_runs_is_what_most_of_them_agree_on() -> None:
    even = _steps(rest=20.0)
    t = TICK * np.arange(len(even.x))
    grid = _grid()
    for frequency, seen in ((3000.0, True), (300.0, False)):
        ringing = Ringing(frequency, 300.0)
        after = np.maximum(t - grid.end, 0.0)
        swing = (t > grid.end) * (ringing.columns(after) @ [2e-8, 1e-8])
        found = run_search.fit_ringing_down(replace(even, x=even.x + swing), [grid])
        assert (found is not None) is seen
        if found is not None:
            assert found.frequency == pytest.approx(frequency, rel=5e-3)
            assert found.decay == pytest.approx(300.0, rel=0.1)
