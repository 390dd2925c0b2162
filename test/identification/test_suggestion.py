# SPDX-License-Identifier: Apache-2.0
"""What to measure next, against random runs and against what then comes out."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from bench_traces import Axis, Drive, Sensor
from experiments import experiment, small, truth_of

from stickslip_ros.identification import Experiment, identify
from stickslip_ros.identification.fit import Estimate, Suggestion
from stickslip_ros.identification.free import free_parameters
from stickslip_ros.identification.intervals import Surroundings, deviations_of
from stickslip_ros.identification.problem import Problem
from stickslip_ros.identification.suggestion import CandidateSensor, candidate_of, suggest
from stickslip_ros.identification.trace import Trace
from stickslip_ros.motion.motion import Motion
from stickslip_ros.parameters import Parameters

#: Records of 20 ms.
RECORDS = CandidateSensor(5e5, 10_000, 1e-9)


def at_truth(axis: Axis, run: tuple[Parameters, Motion]) -> Surroundings:
    """What a run shows about the true values."""
    truth = truth_of(axis)
    fit = Trace(Experiment.of(run[0].replace(**truth), run[1]))
    problem = Problem([fit], free_parameters([fit.parameters], list(truth)))
    point = problem.point(problem.begin(np.log(list(truth.values()))))
    assert point is not None
    return Surroundings(problem, point, stops=False)


def widest(known: Surroundings, drive: Parameters) -> float:
    """Standard deviation of the logarithm that is known worst, with one run more."""
    one = candidate_of(drive, known, RECORDS, RECORDS.rate)
    assert one is not None
    return float(deviations_of(known.shared_information() + one.information).max())


def suggestion(axis: Axis, known: Surroundings, records: CandidateSensor) -> Suggestion:
    """What is suggested where the estimates are the true values."""
    deviations = deviations_of(known.shared_information())
    estimates = {
        name: Estimate(name, value, value * math.exp(-1.96 * d), value * math.exp(1.96 * d))
        for (name, value), d in zip(truth_of(axis).items(), deviations.tolist(), strict=True)
    }
    parts: list[float] = []
    told = suggest(known, known.problem.fits[0].parameters, estimates, records, parts.append)
    assert told is not None
    assert parts == sorted(parts) and len(set(parts)) > 20 and parts[-1] == 1.0
    assert told.parameter == list(estimates)[int(np.argmax(deviations))]
    return told


@pytest.mark.long
def test_it_leaves_the_widest_interval_narrower_than_runs_by_lot() -> None:
    """One run as suggested against the better half of twelve at random."""
    axis, run = small()
    known = at_truth(axis, run)
    base = known.problem.fits[0].parameters
    told = suggestion(axis, known, RECORDS)
    same = ("amplitude", "frequency", "slewrate", "payload")
    drive = base.replace(**{name: getattr(told, name) for name in same})
    random = np.random.default_rng(5)
    by_lot = [
        base.replace(
            frequency=math.exp(random.uniform(math.log(300.0), math.log(2000.0))),
            amplitude=float(random.uniform(100.0, 300.0)),
        )
        for _ in range(12)
    ]
    found = [widest(known, one) for one in by_lot]
    assert widest(known, drive) < 0.6 * np.median(found)


@pytest.mark.long
def test_the_run_that_it_suggests_narrows_the_widest_interval_as_predicted() -> None:
    axis, first = small()
    before = identify([first], suggest_next=True)
    told = before.next
    assert told is not None
    assert told.text.startswith("measure ")
    widths = {
        name: one.high / one.low  # type: ignore[operator]
        for name, one in before.parameters.items()
        if name not in ("amplifier_lag", "sensor_width")
    }
    assert told.parameter == max(widths, key=lambda name: widths[name])
    assert 0.0 < told.amplitude <= 300.0
    assert told.rate <= 5.01e5

    heavier = replace(axis, mass=axis.mass + told.payload)
    drive = Drive(told.steps, told.frequency, told.amplitude, 1, 4e-3, slewrate=1e6 * told.slewrate)
    assert told.spring is None
    second = experiment(heavier, drive, Sensor(rate=told.rate, noise=1e-9), 8)
    one = identify([first, second]).parameters[told.parameter]
    assert one.low is not None and one.high is not None
    found, predicted = math.log(one.high / one.low), math.log(told.high / told.low)
    assert found == pytest.approx(predicted, rel=0.4)
    assert found < 0.6 * math.log(widths[told.parameter])


def test_no_drive_is_suggested_that_is_faster_than_samples_tell() -> None:
    axis, (known, motion) = small()
    slow = Motion(motion.source, motion.t[::10], motion.x[::10])
    told = suggestion(axis, at_truth(axis, (known, slow)), CandidateSensor(5e4, 1000, 1e-9))
    assert told.frequency * 24.0 <= told.rate <= 5.01e4


@pytest.mark.long
def test_a_fit_suggests_nothing_that_its_sensor_cannot_see() -> None:
    """One trace of few samples: no drive faster than they tell."""
    _, (known, motion) = small()
    slow = Motion(motion.source, motion.t[::10], motion.x[::10])
    found = identify([(known, slow)], ["sigma_0ss"], suggest_next=True)
    assert found.next is not None
    assert found.next.frequency * 24.0 <= found.next.rate <= 5.01e4
    assert json.loads(json.dumps(found.as_json()))["next"]["parameter"] == "sigma_0ss"
