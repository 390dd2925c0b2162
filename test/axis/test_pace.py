# SPDX-License-Identifier: Apache-2.0
"""Simulated time, its stamps, and what is done when the processor is too slow."""

import random
from types import SimpleNamespace
from typing import cast

import pytest
from hypothesis import given
from hypothesis import strategies as some

from stickslip_ros.axis import Axis, Event, Pace
from stickslip_ros.axis.pace import PaceSettings
from stickslip_ros.axis.resimulation import Rerun

STEADY, STAMP = 5_000_000_000, 1_700_000_000_000_000_000
DAY = 86_400 * 10**9
BLOCK = 10_000_000  # ns
SETTINGS = PaceSettings()


class Machine:
    """An axis whose motion costs a known time of a processor, and both clocks."""

    def __init__(self, cost: float = 0.0, fixed: float = 0.0, factor: float = 1.0) -> None:
        self.cost, self.fixed = cost, fixed  # s of processor for a second of motion; for a call
        self.spent, self.steady, self.longest = 0.0, STEADY, 0.0
        self.actuation, self.moving = SimpleNamespace(t=0.0), False
        self.axis = cast(Axis, self)
        self.pace = Pace([self.axis], factor, STEADY, STAMP, lambda: self.spent)

    def advance(self, t: float) -> None:
        self.spent += self.cost * (t - self.actuation.t) + self.fixed
        self.actuation.t = t

    def block(self, ns: int = BLOCK) -> bool:
        """Let real time go by, at least what the last call took, and run the next block."""
        self.steady += ns
        before = self.spent
        shown = self.pace.catch_up(self.steady)
        took = self.spent - before
        self.longest = max(self.longest, took)
        self.steady += round(1e9 * took)
        return shown

    def run(self, blocks: int) -> float:
        """Run blocks; return simulated over real time."""
        begin = self.pace.ns, self.steady
        for _ in range(blocks):
            self.block()
        return (self.pace.ns - begin[0]) / (self.steady - begin[1])


def test_stamps_follow_the_steady_clock_alone() -> None:
    """The clock of the machine is asked once, so setting it back changes no stamp."""
    pace = Machine().pace
    assert (pace.ns, pace.stamp) == (0, STAMP)
    pace.catch_up(STEADY + 10_000_001)
    assert (pace.ns, pace.stamp) == (10_000_001, STAMP + 10_000_001)
    assert pace.seconds == 10_000_001 * 1e-9


@given(some.lists(some.integers(0, 10**9)), some.sampled_from([0.1, 1.0, 100.0]))
def test_time_never_runs_back(readings: list[int], factor: float) -> None:
    pace = Machine(factor=factor).pace
    for reading in readings:
        before = pace.ns
        assert pace.catch_up(STEADY + reading)
        assert pace.ns == max(before, int(reading * factor))


def test_single_nanoseconds_count_after_a_year() -> None:
    machine = Machine(factor=1e4, fixed=1e-9)
    for k in range(1, 11):
        machine.pace.catch_up(STEADY + k * DAY // 1000)
    assert machine.pace.ns == 100 * DAY
    machine = Machine(fixed=SETTINGS.at_once)  # the first piece takes all: the rest is dropped
    machine.pace.catch_up(STEADY + 365 * DAY)
    before = machine.pace.ns
    machine.pace.catch_up(STEADY + 365 * DAY + 1)
    assert machine.pace.ns == before + 1


def test_with_a_factor_of_0_only_leaps_move_it() -> None:
    machine = Machine(factor=0.0)
    pace = machine.pace
    pace.catch_up(STEADY + DAY)
    assert pace.ns == 0
    assert pace.leap(BLOCK, 1.0)
    pace.act(STEADY + 2 * DAY, machine.axis)
    acted = BLOCK + 1  # each command acts later than the one before
    assert (pace.ns, pace.stamp) == (acted, STAMP + acted)
    machine.cost = 10.0  # a leap of 100 ms of processor
    leaps = [pace.leap(BLOCK, 5e-3) for _ in range(40)]
    assert 4 <= leaps.count(True) + 2 <= 4 + 4
    assert (pace.ns - acted) % BLOCK == 0 or not leaps[-1]


def test_what_is_shown_after_a_command_is_later_than_it() -> None:
    machine = Machine(factor=1e-9)
    machine.block()
    machine.pace.act(machine.steady, machine.axis)
    acted = machine.pace.ns
    assert machine.block()
    assert machine.pace.ns == acted + 1


def test_a_slip_that_costs_much_more_than_the_rise_is_met_in_small_pieces() -> None:
    """What it costs is not known before, and nobody is heard meanwhile."""
    machine = Machine(cost=0.05)
    machine.moving = True
    machine.run(100)
    machine.cost = 35.0
    machine.run(100)
    assert machine.longest <= 35.0 * SETTINGS.longest_moving + SETTINGS.at_once < 0.2


def test_cheap_motion_loses_nothing() -> None:
    machine = Machine(cost=0.3)
    machine.run(1000)
    assert machine.pace.dropped == 0
    assert machine.pace.report(machine.steady).overload == 0.0


@pytest.mark.parametrize("cost", [1.0, 5.0, 100.0, 1e4])
def test_motion_that_costs_too_much_is_slower_and_each_call_short(cost: float) -> None:
    """The old law simulated the whole lag in one piece, so that each was longer than the last."""
    machine = Machine(cost)
    machine.run(20)  # the first piece is longer, as nobody knew
    machine.longest = 0.0
    factor = machine.run(1000)
    # At least what fits between two timers, at most the share.
    assert 0.4 / cost < factor < 1.01 * SETTINGS.share / cost
    assert machine.longest <= SETTINGS.at_once + 2 * SETTINGS.piece
    report = machine.pace.report(machine.steady)
    assert report.overload > 1.0
    assert report.cost == pytest.approx(cost, rel=0.05)


def test_a_sudden_cost_is_found_out_within_a_piece() -> None:
    """Sixteen contacts that rest, then step at 20 kHz: told by the command, or not."""
    machine = Machine(cost=1e-3)
    machine.run(100)
    machine.pace.act(machine.steady, machine.axis)
    machine.pace.expect_change()
    machine.cost = 5.0
    machine.run(10)
    assert machine.longest <= SETTINGS.at_once + SETTINGS.piece * 5.0
    machine = Machine(cost=1e-3)
    machine.run(100)
    machine.cost = 5.0
    machine.run(10)
    assert machine.longest <= SETTINGS.longest * 5.0


def test_a_pace_that_recovers_goes_on_without_a_burst() -> None:
    machine = Machine(cost=5.0)
    machine.run(500)
    machine.cost = 0.1
    machine.run(50)
    lost = machine.pace.dropped
    before = machine.pace.ns
    machine.block()
    assert machine.pace.ns - before == pytest.approx(BLOCK, rel=0.2)
    assert machine.run(500) == pytest.approx(1.0)
    assert machine.pace.dropped == lost
    machine.pace.report(machine.steady)
    machine.run(100)
    assert machine.pace.report(machine.steady).overload == 0.0


def test_another_factor_goes_on_from_where_the_time_is_though_some_was_dropped() -> None:
    machine = Machine(cost=5.0)
    machine.run(500)
    assert machine.pace.dropped > 0
    machine.cost = 0.0
    machine.pace.change(machine.steady, 0.5)
    assert machine.run(100) == pytest.approx(0.5, rel=0.02)


def test_a_pause_that_can_be_made_up_for_is_and_a_long_one_is_not() -> None:
    machine = Machine(cost=0.005)
    machine.run(10)
    machine.block(10**9)
    assert machine.pace.dropped == 0
    machine.block(3600 * 10**9)
    assert machine.pace.dropped > 3500 * 10**9
    assert machine.longest <= SETTINGS.at_once + SETTINGS.piece


def test_a_command_of_an_overloaded_axis_acts_where_the_axis_is() -> None:
    """However many come, and no two at one time: their order can be told from the log."""
    machine = Machine(cost=50.0)
    machine.run(100)
    spent, before = machine.spent, machine.pace.ns
    for _ in range(1000):
        machine.steady += 10**6
        machine.pace.act(machine.steady, machine.axis)
    assert machine.spent - spent < 1e-3
    assert machine.pace.ns == before + 1000
    machine.steady += 10**8
    assert machine.block()
    assert machine.pace.ns > before


def test_calls_that_cost_a_fixed_time_take_no_more_than_the_share() -> None:
    """However short the pieces get; as with many events in a moment."""
    machine = Machine(cost=0.1, fixed=2e-3)
    machine.run(100)
    begin = machine.spent, machine.steady
    machine.run(1000)
    assert machine.spent - begin[0] <= 0.8 * 1e-9 * (machine.steady - begin[1])


def test_axes_of_one_process_keep_one_time_also_when_one_was_commanded() -> None:
    machine, other = Machine(cost=0.1), Machine(cost=0.1)
    pace = Pace([machine.axis, other.axis], 1.0, STEADY, STAMP, lambda: machine.spent + other.spent)
    pace.act(STEADY + BLOCK, machine.axis)
    assert (machine.actuation.t, other.actuation.t) == (pace.seconds, 0.0)
    assert pace.catch_up(STEADY + 2 * BLOCK)
    assert machine.actuation.t == other.actuation.t == pace.seconds == 2e-9 * BLOCK
    pace.act(STEADY + 3 * BLOCK, machine.axis)
    led = pace.ns
    assert pace.leap(BLOCK, 1.0)  # from the one that is ahead
    assert machine.actuation.t == other.actuation.t == 1e-9 * (led + BLOCK)
    other.cost = 100.0  # it falls behind; what is ahead waits, and both meet again
    pace.act(STEADY + 5 * BLOCK, machine.axis)
    shown = [pace.catch_up(STEADY + (6 + k) * BLOCK) for k in range(2000)]
    assert True in shown
    assert machine.actuation.t == other.actuation.t == pace.seconds


def test_a_fault_from_outside_is_repeated() -> None:
    """Its reason is the machine's, so it is in the log and comes back from there."""
    axis = Axis({"frequency": 1000.0})
    axis.command("jog", 1000.0)
    axis.advance(0.0105)
    axis.trip("too slow")
    assert axis.fault == "too slow"
    axis.advance(0.02)
    axis.command("reset")
    axis.command("steps", 3)
    axis.advance(0.05)
    events: list[Event] = axis.take_events()
    again = Rerun(events).advance(0.05)
    assert again.state == axis.state
    assert [(e.time, e.name, e.outcome) for e in again.take_events()] == [
        (e.time, e.name, e.outcome) for e in events
    ]


def led_at_random(rng: random.Random, jog: bool) -> tuple[list[Event], Axis]:
    """Move an axis while its time is stopped, stepped and led at any pace; return what it did."""
    axis = Axis({"frequency": 1000.0, "start_paused": True})
    pace = Pace([axis], 0.0, STEADY, STAMP, lambda: 0.0)
    steady = STEADY
    for _ in range(12):
        steady += rng.randrange(3 * BLOCK)
        act = rng.randrange(6)
        if act == 0:
            pace.act(steady, axis)
            axis.command("pause", not axis.paused)
        if act in (0, 1):
            pace.change(steady, 0.0 if axis.paused else rng.choice((0.0, 0.1, 1.0, 3.7)))
        elif act == 2:
            pace.leap(rng.randrange(1, BLOCK), rng.choice((1e-9, 1.0)))
        elif act == 3:
            pace.act(steady, axis)
            if jog:
                axis.command("jog", rng.uniform(-2000.0, 2000.0))
            else:
                axis.command("steps", rng.randrange(-9, 9))
        elif act == 4:
            pace.act(steady, axis)
            axis.command("parameters", {"real_time_factor": rng.uniform(0.0, 9.0)})
        pace.catch_up(steady)
    return axis.take_events(), axis


@pytest.mark.long
@pytest.mark.parametrize("count", [60, pytest.param(1000, marks=pytest.mark.long)])
def test_any_pauses_steps_and_paces_leave_the_motion_as_it_is(count: int) -> None:
    """To the last bit that of an axis that only hears the commands of motion, at their times."""
    rng = random.Random(26)
    moved = 0
    for number in range(count):
        events, axis = led_at_random(rng, jog=number % 3 == 0)
        motion = [e for e in events if e.name in ("start", "steps", "jog")]
        again = Rerun(motion).advance(axis.actuation.t)
        assert again.state == axis.state, number
        assert Rerun(events).advance(axis.actuation.t).state == axis.state, number
        moved += axis.state.x != 0.0
    assert moved > 0.4 * count


def test_a_followed_clock_is_caught_up_with_and_nothing_is_dropped() -> None:
    """Jumps ahead of it take as long as they cost, however long it stands still before."""
    machine, clock = Machine(cost=0.5), [0]
    pace = machine.pace = Pace(
        [machine.axis], 1.0, STEADY, STAMP, lambda: machine.spent, lambda: clock[0]
    )
    machine.run(10)
    assert pace.ns == 0
    clock[0] = 10**10
    machine.run(100)
    assert 0 < pace.ns < 10**10
    assert pace.report(machine.steady).overload > 0.0
    assert machine.longest <= SETTINGS.longest
    machine.run(2000)
    assert (pace.ns, pace.dropped) == (10**10, 0)
    pace.report(machine.steady)
    machine.run(10)
    assert pace.report(machine.steady).overload == 0.0


@pytest.mark.parametrize("rate", [0.25, 0.5, 2.0])
def test_a_followed_clock_that_is_slow_or_fast_is_no_overload(rate: float) -> None:
    """The axes go as the clock goes; what is too much for the machine is told all the same."""
    machine = Machine(cost=0.1)

    def clock() -> int:
        return round(rate * (machine.steady - STEADY))

    pace = machine.pace = Pace([machine.axis], 1.0, STEADY, STAMP, lambda: machine.spent, clock)
    for _ in range(5):
        machine.run(100)
        report = pace.report(machine.steady)
        assert report.factor == pytest.approx(rate, rel=0.02)
        assert report.overload == 0.0
    machine.cost = 2.0 / rate
    machine.run(100)
    assert pace.report(machine.steady).overload > 0.0
