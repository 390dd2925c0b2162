# SPDX-License-Identifier: Apache-2.0
"""Simulated time and stamps by a steady clock: they rise, to the nanosecond, whatever happens."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as some

from stickslip_ros.axis import Timeline

STEADY, STAMP = 5_000_000_000, 1_700_000_000_000_000_000
DAY = 86_400 * 10**9


def test_stamps_follow_the_steady_clock_alone() -> None:
    """The clock of the machine is asked once, so setting it back changes no stamp."""
    timeline = Timeline(STEADY, STAMP, 1.0)
    assert (timeline.ns, timeline.stamp) == (0, STAMP)
    timeline.follow(STEADY + 10_000_001)
    assert (timeline.ns, timeline.stamp) == (10_000_001, STAMP + 10_000_001)
    assert timeline.seconds == 10_000_001 * 1e-9


@given(some.lists(some.integers(0, 10**12)), some.sampled_from([0.1, 1.0, 100.0]))
def test_time_never_runs_back(readings: list[int], factor: float) -> None:
    timeline = Timeline(STEADY, STAMP, factor)
    for reading in readings:
        before = timeline.ns
        timeline.follow(STEADY + reading)
        assert timeline.ns == max(before, int(reading * factor))


def test_single_nanoseconds_count_after_a_year() -> None:
    timeline = Timeline(STEADY, STAMP, 1.0)
    timeline.follow(STEADY + 365 * DAY + 1)
    assert timeline.ns == 365 * DAY + 1


def test_with_a_factor_of_0_only_leaps_move_it() -> None:
    timeline = Timeline(STEADY, STAMP, 0.0)
    timeline.follow(STEADY + DAY)
    assert timeline.ns == 0
    timeline.leap(10_000_000)
    timeline.follow(STEADY + 2 * DAY)
    assert (timeline.ns, timeline.stamp) == (10_000_000, STAMP + 10_000_000)
