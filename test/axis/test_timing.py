# SPDX-License-Identifier: Apache-2.0
"""Deadlines kept without drift, late ones counted and skipped."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as some

from stickslip_ros.axis import Pacer


def test_on_time_nothing_is_missed() -> None:
    pacer = Pacer(0.01, 5.0)
    assert [pacer.tick(5.0 + 0.01 * k) for k in range(1, 1000)] == [True] * 999
    assert pacer.missed == 0
    assert pacer.worst_lag < 1e-9


def test_lateness_never_adds_up() -> None:
    """Each tick is 3 ms late; deadlines stay where they were, so none is ever missed."""
    pacer = Pacer(0.01, 0.0)
    assert all(pacer.tick(0.01 * k + 0.003) for k in range(1, 500))
    assert pacer.missed == 0
    assert pacer.lag == pytest.approx(0.003)
    assert pacer.worst_lag == pytest.approx(0.003)


def test_late_by_less_than_a_period_is_late_not_missed() -> None:
    """7 ms late is still the third deadline, and the fourth comes when it is due."""
    pacer = Pacer(0.01, 0.0)
    assert [pacer.tick(now) for now in (0.01, 0.027, 0.03)] == [True] * 3
    assert pacer.missed == 0
    assert pacer.worst_lag == pytest.approx(0.007)


def test_late_work_is_skipped_and_counted_not_made_up_for() -> None:
    """A pause over the deadlines 3 to 6 costs four of them, and only one tick follows at once."""
    pacer = Pacer(0.01, 0.0)
    for k in range(1, 3):
        pacer.tick(0.01 * k)
    assert pacer.tick(0.0704)
    assert pacer.missed == 4
    assert pacer.lag == pytest.approx(0.0404)  # behind the third deadline
    assert not pacer.tick(0.0705)
    assert pacer.tick(0.08)
    assert pacer.missed == 4


def test_a_pause_is_a_lag_as_long() -> None:
    """A process that was stopped for 1.5 s: the first deadline after it is that much late."""
    pacer = Pacer(0.01, 0.0)
    assert pacer.tick(0.01)
    assert pacer.tick(1.52)
    assert pacer.missed == 150
    assert pacer.worst_lag == pytest.approx(1.5)


def test_a_late_first_tick_moves_no_deadline() -> None:
    """It is late itself; those that come in time after it are not."""
    pacer = Pacer(0.01, 0.0)
    assert pacer.tick(0.016)
    assert pacer.lag == pytest.approx(0.006)
    assert [pacer.tick(0.01 * k) for k in range(2, 100)] == [True] * 98
    assert pacer.lag < 1e-9
    assert pacer.missed == 0


def test_a_tick_that_comes_a_little_early_is_the_next_one() -> None:
    """A timer may fire a little early; that must neither be dropped nor be seen as late."""
    pacer = Pacer(0.01, 0.0)
    assert pacer.tick(0.0099)
    assert pacer.lag == 0.0
    assert not pacer.tick(0.0101)
    assert pacer.tick(0.0199)
    assert pacer.missed == 0


def test_the_worst_lag_is_that_of_its_window() -> None:
    pacer = Pacer(0.01, 0.0)
    for now in (0.014, 0.021):
        pacer.tick(now)
    assert pacer.worst_lag == pytest.approx(0.004)
    assert pacer.lag == pytest.approx(0.001)
    pacer.forget_worst()
    pacer.tick(0.032)
    assert pacer.worst_lag == pytest.approx(0.002)


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
