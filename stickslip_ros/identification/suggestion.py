# SPDX-License-Identifier: Apache-2.0
"""Suggests the next measurement: the run after which the widest interval is narrowest.

Each candidate is simulated with the values found, sampled and binned as a measurement. Its Jacobian
gives its information about the logarithms. The information of independent measurements adds up; the
inverse of the sum is the expected covariance (minimax design: the largest of its variances is made
smallest, whichever parameter it belongs to).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stickslip_ros.arrays import Array
from stickslip_ros.identification.experiment import (
    FEW_STEPS,
    Experiment,
    IdentificationError,
    Stepping,
)
from stickslip_ros.identification.fit import Estimate, Suggestion
from stickslip_ros.identification.free import LAG, WIDTH, FreeParameters
from stickslip_ros.identification.intervals import Surroundings, deviations_of, information_of
from stickslip_ros.identification.problem import Problem
from stickslip_ros.identification.search import place_runs
from stickslip_ros.identification.trace import Trace
from stickslip_ros.measurement.steps.ringing import Ringing
from stickslip_ros.model import Plant
from stickslip_ros.motion.motion import Motion
from stickslip_ros.parameters import DriveParameters, ParameterError, Parameters
from stickslip_ros.reporting import CONFIDENCE, format_si
from stickslip_ros.solver import SolverError

#: Candidates: parts of the largest amplitude; of the ringing's frequency, since a drive about as
#: fast slips most of the time and shows its sliding; of preload, mass, sigma_0 and slewrate (more
#: may be beyond the amplifier); of the highest sampling rate so far.
_AMPLITUDES = (0.2, 0.3, 0.45, 0.6, 0.8, 1.0)
_FREQUENCIES = (0.02, 0.04, 0.08, 0.12, 0.2, 0.3, 0.4, 0.5, 0.7, 0.9, 1.1)
_PRELOADS, _PAYLOADS, _SPRINGS = (0.4, 0.7, 1.5, 2.5), (3.0,), (0.1,)
_SLEWRATES, _RATES = (0.2, 0.02), (0.5, 0.25)
#: Samples of a period at least; steps at most; rest before and after, as part of the record and in
#: periods; part of a period by which the start of a run may be found wrong; factor that drives
#: differ by; part of the width that another load or rate has to leave.
_DENSEST, _MOST, _REST, _LEAST_REST, _NEAR, _ALIKE, _CLEARLY = 24.0, 200, 0.06, 1.0, 0.25, 1.7, 0.8
#: Constants that hold for all preloads (Eq. 13, 14); others hold for one preload.
_OVER_PRELOAD = {"sigma_0_slope", "sigma_0_offset", "z_ba_slope", "z_ba_offset"}


@dataclass(frozen=True)
class CandidateSensor:
    """How a candidate is measured: as the runs so far."""

    rate: float  #: highest so far, Hz
    samples: int  #: of a record
    noise: float  #: standard deviation of a sample, m

    @classmethod
    def of(cls, traces: Sequence[Trace], noises: Sequence[float]) -> CandidateSensor:
        """Return the sensor of measured traces with their noise (m)."""
        if not traces:
            return cls(5e5, 10_000, 1e-9)
        counts = [len(fit.experiment.motion.t) for fit in traces]
        rates = [(len(m.t) - 1) / m.duration for m in (fit.experiment.motion for fit in traces)]
        return cls(max(rates), max(counts), float(np.median(noises)))


def suggest(
    around: Surroundings,
    base: Parameters,
    estimates: Mapping[str, Estimate],
    sensor: CandidateSensor,
    progress: Callable[[float], None] = lambda part: None,
) -> Suggestion | None:
    """Return the run that narrows the widest interval most; None if no candidate can be run.

    ``base`` are the parameters of the first experiment; its drive's limits are kept. progress is
    called with the part of the candidates that were simulated.
    """
    problem, known = around.problem, around.shared_information()
    free, theta = problem.free, around.best.unknowns[: problem.count]
    # How much amplifier and sensor lag is no aim of a measurement.
    wanted = [one for one in estimates.values() if one.name not in (LAG, WIDTH)]
    k = _widest(known, wanted)

    drives = [(p, sensor.rate) for p in _drives(base, free, theta)]
    heavier = [base.replace(payload=base.runner.payload + part * base.runner.mass)
               for part in _PAYLOADS]  # fmt: skip
    carrying = [(p, sensor.rate) for one in heavier
                for p in _drives(one, free, theta, _AMPLITUDES[::2])]  # fmt: skip
    looked = itertools.count(1)

    def best(candidates: Iterable[tuple[Parameters, float]]) -> _Candidate | None:
        found = []
        for p, rate in candidates:
            progress(min(next(looked) / len(drives + carrying), 1.0))
            one = candidate_of(p, around, sensor, rate)
            if one is not None:
                deviations = deviations_of(known + one.information)[: len(wanted)]
                found.append(replace(one, deviation=deviations[k], widest=float(deviations.max())))
        return _first_seen(sorted(found, key=lambda one: one.widest), free, theta)

    chosen, loaded = best(drives), best(carrying)
    if chosen is None or (loaded and loaded.widest < _CLEARLY * chosen.widest):
        chosen = loaded
    if chosen is None:
        return None
    for others in (
        ((p, sensor.rate) for p in _loads(chosen.parameters, free, theta)),
        ((chosen.parameters.replace(slewrate=part * base.drive.slewrate), chosen.rate)
         for part in _SLEWRATES),
        ((chosen.parameters, part * sensor.rate) for part in _RATES),
    ):  # fmt: skip
        other = best(others)
        if other is not None and other.widest < _CLEARLY * chosen.widest:
            chosen = other
    return _describe(wanted[k], chosen, base.drive)


@dataclass(frozen=True)
class _Candidate:
    """A run that could be measured."""

    parameters: Parameters  #: what is known of it
    rate: float  #: Hz
    steps: int
    rest: float  #: before the steps, s
    motion: Motion  #: as it would be measured
    information: Array  #: that it adds
    deviation: float = math.inf  #: of the logarithm whose interval is widest now, with it
    widest: float = math.inf  #: of all logarithms' standard deviations, with it

    def is_seen(self, own: Parameters) -> bool:
        """Return whether its steps would be found in the measurement, own being its parameters.

        As in a search, models laid over it may correct its start and the number of its steps.
        """
        try:
            fit = Trace(Experiment.of(self.parameters, self.motion))
            place_runs(fit, [own])
        except (IdentificationError, ParameterError, SolverError):
            return False
        runs = fit.experiment.runs
        late = abs(runs[0].start - self.rest) * self.parameters.drive.frequency
        return [run.steps for run in runs] == [self.steps] and late < _NEAR


def _first_seen(
    candidates: Sequence[_Candidate], free: FreeParameters, theta: Array
) -> _Candidate | None:
    """Return the first candidate whose steps would be found.

    It takes a second to try one. Where the steps of a drive are not found, those of somewhat
    faster ones with as little amplitude are not looked for.
    """
    failed: list[DriveParameters] = []
    for one in candidates:
        drive = one.parameters.drive
        if any(
            f.frequency <= drive.frequency < _ALIKE * f.frequency and drive.amplitude <= f.amplitude
            for f in failed
        ):
            continue
        if one.is_seen(free.applied(one.parameters, theta)):
            return one
        failed.append(drive)
    return None


def _widest(known: Array, estimates: Sequence[Estimate]) -> int:
    """Return the number of the parameter whose interval is widest, by its logarithm."""
    widths, deviations = [], deviations_of(known)
    for k, one in enumerate(estimates):
        width = 2.0 * CONFIDENCE * float(deviations[k])
        if one.low is None or one.high is None:
            width += 100.0  # an end that is missing is wider than any that is there
        elif one.low > 0.0:
            width = math.log(one.high / one.low)
        widths.append(width)
    return int(np.argmax(widths))


def _drives(
    base: Parameters,
    free: FreeParameters,
    theta: Array,
    amplitudes: Sequence[float] = _AMPLITUDES,
) -> Iterator[Parameters]:
    ringing = Plant.of(free.applied(base, theta)).ringing_frequency
    for part in amplitudes:
        for share in _FREQUENCIES:
            frequency = min(share * ringing, base.drive.max_frequency)
            yield base.replace(amplitude=part * base.actuator.max_voltage, frequency=frequency)


def _loads(p: Parameters, free: FreeParameters, theta: Array) -> Iterator[Parameters]:
    if _OVER_PRELOAD & set(free.names):
        for part in _PRELOADS:
            yield p.replace(preload=part * p.friction.preload)
    # Few benches have a spring; without the mass, nothing else determines it.
    stiffness = Plant.of(free.applied(p, theta)).contact.sigma_0
    for part in _SPRINGS if "mass" in free.names or p.runner.spring else ():
        yield p.replace(spring=float(f"{part * stiffness:.1g}"))


def candidate_of(
    p: Parameters, around: Surroundings, sensor: CandidateSensor, rate: float
) -> _Candidate | None:
    """Return a run with its information; None if it cannot be run or sampled."""
    frequency, record = p.drive.frequency, sensor.samples / rate
    rest = max(_REST * record, _LEAST_REST / frequency)
    steps = min(int((record - 2.0 * rest) * frequency), _MOST)
    if rate < _DENSEST * frequency or steps < FEW_STEPS:
        return None
    t = np.arange(0.0, steps / frequency + 2.0 * rest, 1.0 / rate)
    shared = around.best.unknowns[: around.problem.shared]
    free, nuisances = around.problem.free, around.problem.nuisances
    try:
        own = around.problem.applied(p, shared)
        plant = Plant.of(own)
        decay = (plant.contact.sigma_1 + plant.contact.sigma_2) / (2.0 * plant.mass)
        ringing = Ringing(plant.ringing_frequency, decay) if plant.ringing_frequency else None
        motion = Motion("candidate", t, np.zeros_like(t))
        experiment = Experiment(p, motion, (Stepping(rest, steps, frequency),), ringing)
        x, _ = experiment.simulate(own, np.array([rest]), t)
        noise = sensor.noise * np.random.default_rng(1).standard_normal(len(t))
        motion = Motion("candidate", t, x + noise)
        trace = Trace(replace(experiment, motion=motion))
    except (ParameterError, SolverError):
        return None
    trace.set_noise(np.array([sensor.noise**2 / trace.blocks.count, 0.0, 0.0]))
    problem = Problem([trace], replace(free, priors={}), nuisances)
    point = problem.point(problem.begin(shared))
    if point is None:
        return None
    information = information_of(problem, problem.jacobian(point))
    for k, one in enumerate(nuisances, problem.count):  # its prior is known already
        information[k, k] -= one.deviation**-2
    return _Candidate(p, rate, steps, rest, motion, information)


def _describe(one: Estimate, chosen: _Candidate, usual: DriveParameters) -> Suggestion:
    p, rate, steps = chosen.parameters, chosen.rate, chosen.steps
    low, high = (one.value * math.exp(sign * CONFIDENCE * chosen.deviation) for sign in (-1.0, 1.0))
    d, runner = p.drive, p.runner
    drive = f"{steps} steps with {d.amplitude:.4g} V at {d.frequency:.4g} Hz"
    load = f", preload {p.friction.preload:.3g} N"
    if d.slewrate != usual.slewrate:
        load += f", a slewrate of {d.slewrate:.3g} V/us"
    if runner.payload > 0.0:
        load += f", a payload of {1e3 * runner.payload:.3g} g"
    if runner.spring:
        load += f", against a spring of {format_si(runner.spring, 'N/m', 2)}"
    text = (
        f"measure {drive}{load}, sampled at {rate:.4g} Hz: the interval of {one.name} should "
        f"shrink to {format_si(low, one.unit, 4)} to {format_si(high, one.unit, 4)}"
    )
    return Suggestion(
        amplitude=d.amplitude, frequency=d.frequency, slewrate=d.slewrate,
        preload=p.friction.preload, payload=runner.payload, spring=runner.spring, rate=rate,
        steps=steps, parameter=one.name, low=low, high=high, text=text,
    )  # fmt: skip
