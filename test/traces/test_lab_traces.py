# SPDX-License-Identifier: Apache-2.0
"""Whole traces of many kinds, integrated apart from the package, and what is said of each."""

from __future__ import annotations

import numpy as np
import pytest

from stickslip_ros.measurement.reading.motion import without_fringe_jumps
from stickslip_ros.traces.analysis import find_runs
from validation.campaigns.lab_traces import FRINGE, lab_trace
from validation.campaigns.traces import DOUBTFUL, NONE, RIGHT, Study

pytestmark = pytest.mark.slow

#: Traces whose runs, steps, directions, frequency, step size and backstep are found.
FOUND = [
    ("no rest before", 51), ("3 to 6 samples a swing", 51), ("spikes", 51), ("creep", 52),
    ("tiny steps", 52), ("3 to 5 cycles", 62), ("jitter", 62), ("gaps", 62), ("hum", 62),
    ("part of a last cycle", 62), ("polynomial drift", 62), ("plain", 63), ("nothing", 51),
    ("part of a last cycle", 441), ("part of a last cycle", 444), ("10 to 14 samples a cycle", 446),
    ("1.5 to 3 samples a swing", 62), ("1.5 to 3 samples a swing", 441), ("slow", 442),
    ("white noise", 447), ("10 to 14 samples a cycle", 950002),
    ("10 to 14 samples a cycle", 951001), ("pink noise", 950002), ("no rest after", 48201),
    ("plain", 48201), ("polynomial drift", 48200), ("creep", 48200), ("3 to 5 cycles", 48201),
    ("pink noise", 48200), ("hum", 48202), ("hum", 49206), ("strong hum", 51),
    ("strong hum", 48202), ("part of a last cycle", 92), ("at random", 49500),
    ("10 to 14 samples a cycle", 51003), ("10 to 14 samples a cycle", 51015), ("jitter", 51003),
    ("tiny steps", 52002),
]  # fmt: skip
#: Traces that hold too little, or that something hides: they have to be doubted.
HIDDEN = [
    ("no rest", 51), ("3 to 5 samples a cycle", 51), ("5 to 9 samples a cycle", 51),
    ("5 to 9 samples a cycle", 48200), ("fringe jumps", 62), ("1 to 2 cycles", 63),
    ("random walk", 62), ("random walk", 8104), ("white noise", 49706),
    ("3 to 5 samples a cycle", 52006), ("5 to 9 samples a cycle", 53003),
    ("part of a last cycle", 51013),
]  # fmt: skip
#: Traces that are found and take seconds.
LONG = [
    ("no rest after", 51), ("two amplitudes", 51), ("slow", 51), ("slow", 47000),
    ("both ways", 62), ("700 cycles", 62), ("700 cycles", 48201), ("slow", 49706),
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


@pytest.mark.parametrize(
    ("kind", "seed"),
    [
        ("no rest before", 51),
        ("hum", 62),
        ("plain", 63),
        ("10 to 14 samples a cycle", 47200),
        ("both ways", 48200),
        ("1.5 to 3 samples a swing", 49501),
        ("strong hum", 49501),
    ],
)
def test_a_trace_of_a_known_frequency_is_read_right(kind: str, seed: int) -> None:
    study = Study(told=True)
    study.add(lab_trace(kind, seed))
    assert set(study.verdicts[kind]) == {RIGHT}, study


def test_lost_fringes_are_named_and_nothing_is_lost_without_them() -> None:
    lost = lab_trace("fringe jumps", 101)
    (run,) = lost.runs
    doubts = [doubt for one in find_runs(lost.t, lost.x) for doubt in one.doubts]
    assert any("jumps by 310.4 nm" in doubt and "--wavelength" in doubt for doubt in doubts)
    x, note = without_fringe_jumps(lost.x, FRINGE)
    assert note == "3 jumps by whole fringes of 316.4 nm taken out"
    (found,) = find_runs(lost.t, x)
    assert (found.steps, found.doubts) == (run.steps, ())
    assert found.step_size == pytest.approx(run.step_size, abs=3.0 * found.step_size_error)


def test_fast_motion_makes_a_jump_a_guess() -> None:
    x = np.array([0.0, 10.0, 160.0, 480.0, 480.0]) * 1e-9
    assert "; 1 samples move by about half a fringe" in without_fringe_jumps(x, FRINGE)[1]
