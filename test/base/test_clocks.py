# SPDX-License-Identifier: Apache-2.0
"""Times by clocks that are set, and that stand while the process does; deadlines."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as some

from stickslip_ros.base.clocks import Pacer, Timetable, UnsetClock, with_ticks

DAY = 86400 * 10**9  # ns


def test_a_clock_that_is_set_leaves_the_order_of_times() -> None:
    now = {"wall": 10 * DAY, "steady": DAY}
    clock = UnsetClock(lambda: now["wall"], lambda: now["steady"])

    def later(ns: int, set_by: int = 0) -> None:
        now["steady"] += ns
        now["wall"] += ns + set_by

    later(1000)
    assert clock.time_of(now["wall"] - 10) == 10 * DAY + 990
    later(1000, set_by=-2 * DAY)
    before_it_was_set = 10 * DAY + 1500  # of a message that waited meanwhile
    assert clock.time_of(before_it_was_set) == before_it_was_set
    assert clock.time_of(now["wall"]) == 10 * DAY + 2000
    assert clock.time_of(before_it_was_set) == before_it_was_set
    assert clock.set_by == -2 * DAY
    later(1000, set_by=500_000_000)  # trimmed
    assert clock.time_of(now["wall"]) == 10 * DAY + 500_003_000
    later(1000, set_by=2 * DAY - 500_000_000)
    assert clock.time_of(now["wall"]) == 10 * DAY + 4000
    assert clock.set_by == 0


class SteadyClock:
    """A clock that moves when slept on."""

    now = 100.0

    def sleep(self, seconds: float) -> None:
        self.now += seconds


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> SteadyClock:
    found = SteadyClock()
    monkeypatch.setattr("stickslip_ros.base.clocks.time.sleep", found.sleep)
    return found


@pytest.mark.parametrize("rate", [0.5, 1.0, 10.0])
def test_everything_comes_at_its_time(clock: SteadyClock, rate: float) -> None:
    timetable = Timetable(rate, lambda: clock.now)
    came = []
    for t in (2.0, 2.25, 3.0, 7.0):
        assert timetable.wait(t, lambda: False)
        came.append(clock.now - 100.0)
    assert came == pytest.approx([(t - 2.0) / rate for t in (2.0, 2.25, 3.0, 7.0)], abs=1e-9)
    assert timetable.moved == 0.0


@pytest.mark.parametrize(
    ("late", "due", "moved", "then", "comes"),
    [(0.1, 0.05, 0.0, 1.0, 101.0), (3.0, 1.0, 2.0, 1.5, 103.5)],
    ids=["a little", "a stop"],
)
def test_a_little_late_is_made_up_for_and_a_stop_moves_what_is_left(
    clock: SteadyClock, late: float, due: float, moved: float, then: float, comes: float
) -> None:
    timetable = Timetable(1.0, lambda: clock.now)
    timetable.wait(0.0, lambda: False)
    clock.now += late
    assert timetable.wait(due, lambda: False)
    assert clock.now == pytest.approx(100.0 + late)
    assert timetable.moved == pytest.approx(moved)
    timetable.wait(then, lambda: False)
    assert clock.now == pytest.approx(comes)


def test_it_ends_in_the_middle_of_a_wait(clock: SteadyClock) -> None:
    timetable = Timetable(1.0, lambda: clock.now)
    timetable.wait(0.0, lambda: False)
    assert not timetable.wait(1000.0, lambda: clock.now > 101.0)
    assert clock.now < 101.1


def test_ticks_lie_between_the_messages() -> None:
    messages = [(1000, "a"), (1000, "b"), (1250, "c"), (1300, "d")]
    assert list(with_ticks(messages, 100)) == [
        (1000, None),
        (1000, "a"),
        (1000, "b"),
        (1100, None),
        (1200, None),
        (1250, "c"),
        (1300, None),
        (1300, "d"),
    ]
    assert list(with_ticks(messages, 0)) == messages
    assert list(with_ticks([], 100)) == []


def at(*times: float) -> list[float]:
    return list(times)


@pytest.mark.parametrize(
    ("ticks", "used", "missed", "lag", "worst"),
    [
        pytest.param([0.01 * k for k in range(1, 1000)], [True] * 999, 0, 0.0, 0.0, id="on time"),
        pytest.param(
            [0.01 * k + 0.003 for k in range(1, 500)], [True] * 499, 0, 3e-3, 3e-3,
            id="lateness never adds up",
        ),
        pytest.param(
            at(0.01, 0.027, 0.03), [True] * 3, 0, 0.0, 7e-3,
            id="7 ms late is still the third deadline, and the fourth comes when it is due",
        ),
        pytest.param(
            at(0.01, 0.02, 0.0704), [True] * 3, 4, 0.0404, 0.0404, id="a pause costs four deadlines"
        ),
        pytest.param(
            at(0.01, 0.02, 0.0704, 0.0705, 0.08), [True, True, True, False, True], 4, 0.0, 0.0404,
            id="and they are not made up for",
        ),
        pytest.param(at(0.01, 1.52), [True] * 2, 150, 1.5, 1.5, id="a stop of the process"),
        pytest.param(
            [0.016, *(0.01 * k for k in range(2, 100))], [True] * 99, 0, 0.0, 6e-3,
            id="a late first tick moves no deadline",
        ),
        pytest.param(
            at(0.0099, 0.0101, 0.0199), [True, False, True], 0, 0.0, 0.0,
            id="a tick a little early is the next one",
        ),
    ],
)  # fmt: skip
def test_deadlines_are_used_late_or_missed(
    ticks: list[float], used: list[bool], missed: int, lag: float, worst: float
) -> None:
    pacer = Pacer(0.01, 5.0)
    assert [pacer.tick(5.0 + now) for now in ticks] == used
    assert pacer.missed == missed
    assert pacer.lag == pytest.approx(lag, abs=1e-9)
    assert pacer.worst_lag == pytest.approx(worst, abs=1e-9)


def test_the_worst_lag_is_that_of_its_window() -> None:
    pacer = Pacer(0.01, 0.0)
    for now in (0.014, 0.021):
        pacer.tick(now)
    assert pacer.worst_lag == pytest.approx(0.004)
    pacer.forget_worst()
    pacer.tick(0.032)
    assert pacer.worst_lag == pytest.approx(0.002)


def test_what_is_missed_while_it_starts_does_not_count() -> None:
    pacer = Pacer(0.01, 5.0, excused=1.0)
    assert [pacer.tick(now) for now in (5.5, 5.99, 6.3)] == [True] * 3
    assert pacer.missed == 30
    assert pacer.worst_lag == pytest.approx(0.3)


def test_few_missed_deadlines_go_without_a_word_and_many_are_not_repeated() -> None:
    """Minutes of single late blocks logged a line a second, which hid the refusals."""
    for every, words in ((200, 0), (20, 6), (2, 9)):
        pacer = Pacer(0.01, 0.0)
        told = 0
        for k in range(1, 10_000):
            if k % every:
                pacer.tick(0.01 * k)
                told += pacer.misses_more()
        assert told == words, every


@given(some.lists(some.floats(0.0, 0.1), max_size=60))
def test_every_deadline_is_used_once_or_missed(pauses: list[float]) -> None:
    """Whatever the pauses: ticks used and deadlines missed make up all that have come."""
    pacer, now, used = Pacer(0.01, 3.0), 3.0, 0
    for pause in pauses:
        now += pause
        missed = pacer.missed
        if pacer.tick(now):
            used += 1
            assert math.floor(pacer.lag / 0.01 + 0.1) == pacer.missed - missed
        assert used + pacer.missed == math.floor((now - 3.0) / 0.01 + 0.1)
