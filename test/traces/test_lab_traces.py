# SPDX-License-Identifier: Apache-2.0
"""Whole traces of many kinds, integrated apart from the package, and what is said of each."""

from __future__ import annotations

import pytest

from validation.campaigns.lab_traces import lab_trace
from validation.campaigns.traces import DOUBTFUL, NONE, RIGHT, Study

pytestmark = pytest.mark.slow

#: Traces whose runs, steps, directions, frequency, step size and backstep are found.
FOUND = [
    ("no rest before", 51), ("3 to 6 samples a swing", 51), ("spikes", 51), ("creep", 52),
    ("tiny steps", 52), ("3 to 5 cycles", 62), ("jitter", 62), ("gaps", 62), ("hum", 62),
    ("part of a last cycle", 62), ("polynomial drift", 62), ("plain", 63), ("nothing", 51),
]  # fmt: skip
#: Traces that hold too little, or that something hides: they have to be doubted.
HIDDEN = [
    ("no rest", 51), ("3 to 5 samples a cycle", 51), ("5 to 9 samples a cycle", 51),
    ("1.5 to 3 samples a swing", 62), ("strong hum", 51), ("fringe jumps", 62),
    ("1 to 2 cycles", 63),
]  # fmt: skip
#: Traces that are found and take seconds.
LONG = [
    ("no rest after", 51), ("two amplitudes", 51), ("slow", 51), ("both ways", 62),
    ("random walk", 62), ("700 cycles", 62),
]  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "seed"),
    [*FOUND, *HIDDEN, *(pytest.param(*one, marks=pytest.mark.long) for one in LONG)],
)
def test_a_trace_is_read_right_or_doubted(kind: str, seed: int) -> None:
    study = Study(told=False)
    study.add(lab_trace(kind, seed))
    hidden = (kind, seed) in HIDDEN
    assert set(study.verdicts[kind]) <= ({DOUBTFUL, NONE} if hidden else {RIGHT}), study


@pytest.mark.parametrize(("kind", "seed"), [("no rest before", 51), ("hum", 62), ("plain", 63)])
def test_a_trace_of_a_known_frequency_is_read_right(kind: str, seed: int) -> None:
    study = Study(told=True)
    study.add(lab_trace(kind, seed))
    assert set(study.verdicts[kind]) == {RIGHT}, study
