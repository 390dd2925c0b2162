# SPDX-License-Identifier: Apache-2.0
"""Times by clocks that are set, and that stand while the process does."""

import pytest

from stickslip_ros.base.clocks import Timetable, UnsetClock, with_ticks

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
