# SPDX-License-Identifier: Apache-2.0
"""What is said of a record before a fit, and what is not claimed where it shows too little."""

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from bench_traces import Axis, Drive, Sensor, bench_trace
from experiments import small

from stickslip_ros.measurement.identification import Experiment, IdentificationError, identify
from stickslip_ros.measurement.identification.experiment import (
    Stepping,
    check_record,
    is_too_coarse,
    without_repeats,
)
from stickslip_ros.measurement.steps.ringing import Ringing
from stickslip_ros.physics.parameters import Parameters
from stickslip_ros.simulation.motion import Motion

#: Steps of 100 nm at 400 Hz, where the actuator goes 150 nm.
KNOWN = Parameters.of({"preload": 0.6, "frequency": 400.0, "amplitude": 280.0})
T = np.arange(0.0, 0.03, 1e-5)
X = 1e-7 * np.floor(np.clip(400.0 * (T - 2e-3), 0.0, 10.0))
NOISE = np.random.default_rng(1).normal(0.0, 1e-9, len(T))
RECORD = Experiment(
    KNOWN, Motion("lab", T, X + NOISE), (Stepping(2e-3, 10, 400.0),), Ringing(7e3, 500.0)
)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({}, None),
        ({"ringing": Ringing(37e3, 500.0)}, r"2\.7 samples in a swing .* sample at 1\.5e\+05 Hz"),
        ({"runs": (Stepping(2e-3, 3, 400.0),)}, "3 steps; measure 4 or more"),
        ({"motion": Motion("lab", T, 1e-3 * X)}, "check the units"),
        (
            {"parameters": KNOWN.replace(sensor_noise=2e-8)},
            r"noise is .* nm a sample, the parameters say 20 nm",
        ),
    ],
)
def test_one_line_says_what_does_not_fit(changed: dict[str, object], words: str | None) -> None:
    said = list(check_record(replace(RECORD, **changed)))  # type: ignore[arg-type]
    if words is None:
        assert said == []
        return
    (line,) = said
    assert line.startswith("lab: ")
    assert re.search(words, line)


def test_a_run_that_is_not_determined_is_left_out() -> None:
    """Two moves of other size beside a run, in the hum of its rest, were fitted as its steps."""
    _, (known, motion) = small()
    since = motion.t - motion.t[0]
    moved = np.array([0.4, 0.5]) * since[-1]
    steps = 0.5 * (1.0 + np.tanh(np.subtract.outer(since, moved) / 3e-4)).sum(axis=1)
    rest = motion.x[-1] - 1e-7 * steps + np.resize(NOISE, len(since))
    t = np.append(motion.t, motion.t[-1] + motion.spacing + since)
    found = Experiment.of(known, Motion("lab", t, np.append(motion.x, rest)))
    assert [one.steps for one in found.runs] == [10]
    said = next(check_record(found))
    assert said.startswith("lab: the 10 steps from ")
    assert "after the run, about as far as in a step" in said


def test_a_few_cycles_of_another_frequency_are_left_out() -> None:
    axis = Axis()
    drives = Drive(12, 400.0, pause=5e-3), Drive(3, 280.0, pause=8e-3)
    bench = bench_trace(axis, drives, Sensor(rate=2e5, noise=1e-9), 8e-3, 3)
    known = Parameters.of({**axis.parameters, "frequency": 400.0, "amplitude": 300.0})
    found = Experiment.of(known, Motion("bench", bench.t, bench.x))
    assert [run.steps for run in found.runs] == [12]
    assert re.search(r"moves by 41\d.\d nm after the run, about as far as", found.left_out[0])


@pytest.mark.parametrize(
    ("known", "t", "x", "words"),
    [
        (KNOWN, T, 1e3 * X, "no runner outruns it; are the columns of runner and actuator swapped"),
        (KNOWN, T, 3.0 * X, "moves by 300 nm in a cycle of 400 Hz, and the actuator goes 149 nm"),
        (KNOWN.replace(gain=1e-6), T, X, "the actuator go 280 µm, and no actuator of a stick-slip"),
        (KNOWN, 1e-3 * T, X, "less than a cycle of 400 Hz; check the unit of the time"),
    ],
)
def test_what_no_axis_does_is_refused_before_the_fit(
    known: Parameters, t: np.ndarray, x: np.ndarray, words: str
) -> None:
    """Swapped columns and impossible units were fitted for 15 s."""
    with pytest.raises(IdentificationError, match=re.escape(words)):
        identify([(known, t, x + NOISE)])


def _held(x: np.ndarray) -> np.ndarray:
    return np.append(x[:2000], np.full(1000, x[2000]))


@pytest.mark.parametrize(
    ("recorded", "step", "left"),
    [
        (lambda x: x, 0.0, 3000),
        (lambda x: x, 2e-9, 3000),  # coarse beside its noise: values repeat by chance
        (_held, 0.0, 2001),
        (_held, 2e-9, 2001),
        (lambda x: np.repeat(x[::5], 5), 0.0, 600),  # a sensor that is slower than its recorder
        (lambda x: np.minimum(x, 5e-7), 0.0, None),
        (lambda x: np.zeros_like(x) + (T > 0.01) * T, 0.0, 3000),  # simulated: at rest at 0
    ],
)
def test_values_that_repeat_are_no_data(
    recorded: Callable[[np.ndarray], np.ndarray], step: float, left: int | None
) -> None:
    """The last value, held for 20 ms after a run, moved all intervals, and nothing was said."""
    x = recorded(X + NOISE)
    x = step * np.round(x / step) if step else x
    kept, said = without_repeats(Motion("lab", T, x))
    if left is None:
        left = int(np.count_nonzero(x < 5e-7)) + 200
        assert len(kept.t) < left < 2200
    else:
        assert len(kept.t) == pytest.approx(left, abs=8)  # before a stretch, too, by chance
    assert bool(said) == (len(kept.t) < 3000)
    assert not said or "repeat the value before" in said[0]
    assert (np.diff(kept.t) > 0.0).all()


def test_a_record_is_too_coarse_for_what_is_seen_or_found() -> None:
    assert not is_too_coarse(RECORD, KNOWN)
    assert is_too_coarse(replace(RECORD, ringing=Ringing(26e3, 500.0)), KNOWN)
    assert is_too_coarse(RECORD, KNOWN.replace(sigma_0=2e8))


def test_nothing_is_claimed_of_a_ringing_with_too_few_samples() -> None:
    """Wrong values in tight intervals came of 2.7 samples a swing, and nothing was said."""
    _, (known, motion) = small()
    thin = slice(None, None, 24)  # 20.8 kHz for ringing at 7 kHz
    said: list[str] = []
    record = Motion("slow", motion.t[thin], motion.x[thin])
    found = identify([(known, record)], ["sigma_0"], say=said.append)
    assert any("samples in a swing" in line for line in said)
    assert found.notes == tuple(said)
    assert found.as_json()["notes"] == said
    assert all((one.low, one.high, one.determined) == (None, None, False)
               for one in found.parameters.values())  # fmt: skip
