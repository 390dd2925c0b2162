# SPDX-License-Identifier: Apache-2.0
"""Deadlines kept without drift, late ones counted and skipped."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as some

from stickslip_ros.axis import Pacer


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
