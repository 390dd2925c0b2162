# SPDX-License-Identifier: Apache-2.0
"""The baselines of control do the tasks for which they are made."""

import numpy as np

from stickslip_ros.gym import TASKS
from validation.control import axis_loop, learned_feedforward, steps_then_scan
from validation.control.__main__ import cell

SEEDS = range(2)


def test_steps_and_a_scan_arrive_in_little_more_than_the_steps_take() -> None:
    scores = steps_then_scan.scores(TASKS["vertical"], SEEDS)
    assert scores.max() < 0.06  # 15 um take 28 ms at 4 kHz and 134 nm a step
    held = steps_then_scan.scores(TASKS["hold"], range(1))
    assert held[0] < 1e-9


def test_a_move_is_learned_in_a_few_trials() -> None:
    """Of a drive whose steps are a fifth smaller than those it was planned with."""
    way = np.array([21.3e-6, -40.7e-6])
    move = learned_feedforward.Move(way, 134e-9)
    for _ in range(learned_feedforward.TRIALS):
        reached = move.side * (move.steps * 107e-9 + move.rest)
        move.correct(way - reached, 160e-9)
    assert np.abs(way - reached).max() < 1e-9
    assert (move.rest >= 0.0).all()
    assert (move.rest <= 160e-9).all()


def test_the_loop_of_an_axis_arrives() -> None:
    assert axis_loop.scores(TASKS["vertical"], range(2)).max() < 0.1


def test_a_cell_counts_what_is_not_done() -> None:
    task = TASKS["vertical"]
    assert cell(task, np.array([0.03, 0.02, np.inf])) == ("25 (22.5 to 27.5) ms; 1 of 3 not done")
    assert cell(task, np.array([np.inf])) == "not done"
