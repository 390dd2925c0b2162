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
from stickslip_ros.identification.experiment import Experiment, IdentificationError, Stepping
from stickslip_ros.identification.fit import Estimate, Suggestion
from stickslip_ros.identification.free import LAG, FreeParameters
from stickslip_ros.identification.least_squares import Problem
from stickslip_ros.identification.noise import Noise
from stickslip_ros.identification.profile import Profiler, deviations_of
from stickslip_ros.identification.search import place_runs
from stickslip_ros.identification.settings import NEXT, RECORD
from stickslip_ros.identification.trace_fit import TraceFit
from stickslip_ros.measurement.steps.ringing import Ringing
from stickslip_ros.model import Plant
from stickslip_ros.motion.motion import Motion
from stickslip_ros.parameters import DriveParameters, ParameterError, Parameters
from stickslip_ros.reporting import CONFIDENCE, format_si
from stickslip_ros.solver import SolverError

#: Constants that hold for all preloads (Eq. 13, 14); others hold for one preload.
_OVER_PRELOAD = {"sigma_0_slope", "sigma_0_offset", "z_ba_slope", "z_ba_offset"}


@dataclass(frozen=True)
class CandidateSensor:
    """How a candidate is measured: as the runs so far."""

    rate: float  #: highest so far, Hz
    samples: int  #: of a record
    noise: float  #: standard deviation of a sample, m

    @classmethod
    def of(cls, traces: Sequence[TraceFit], noises: Sequence[float]) -> CandidateSensor:
        """Return the sensor of measured traces with their noise (m)."""
        if not traces:
            return cls(NEXT.rate, NEXT.samples, NEXT.noise)
        counts = [len(fit.experiment.motion.t) for fit in traces]
        rates = [(len(m.t) - 1) / m.duration for m in (fit.experiment.motion for fit in traces)]
        return cls(max(rates), max(counts), float(np.median(noises)))


def suggest(
    profiler: Profiler,
    base: Parameters,
    estimates: Mapping[str, Estimate],
    sensor: CandidateSensor,
    progress: Callable[[float], None] = lambda part: None,
) -> Suggestion | None:
    """Return the run that narrows the widest interval most; None if no candidate can be run.

    ``base`` are the parameters of the first experiment; its drive's limits are kept. progress is
    called with the part of the candidates that were simulated.
    """
    free = profiler.problem.free
    known = profiler.information()
    theta = profiler.best.unknowns[: len(free.names)]
    # How much an amplifier lags is no aim of a measurement.
    wanted = [one for one in estimates.values() if one.name != LAG]
    k = _widest(known, wanted)

    drives = [(p, sensor.rate) for p in _drives(base, free, theta)]
    heavier = [base.replace(payload=base.runner.payload + part * base.runner.mass)
               for part in NEXT.payloads]  # fmt: skip
    carrying = [(p, sensor.rate) for one in heavier
                for p in _drives(one, free, theta, NEXT.amplitudes[::2])]  # fmt: skip
    looked = itertools.count(1)

    def best(candidates: Iterable[tuple[Parameters, float]]) -> _Candidate | None:
        found = []
        for p, rate in candidates:
            progress(min(next(looked) / len(drives + carrying), 1.0))
            one = candidate_of(p, free, theta, sensor, rate)
            if one is not None:
                deviations = deviations_of(known + one.information)[: len(wanted)]
                found.append(replace(one, deviation=deviations[k], widest=float(deviations.max())))
        return _first_seen(sorted(found, key=lambda one: one.widest), free, theta)

    chosen, loaded = best(drives), best(carrying)
    if chosen is None or (loaded and loaded.widest < NEXT.clearly * chosen.widest):
        chosen = loaded
    if chosen is None:
        return None
    for others in (
        ((p, sensor.rate) for p in _loads(chosen.parameters, free, theta)),
        ((chosen.parameters.replace(slewrate=part * base.drive.slewrate), chosen.rate)
         for part in NEXT.slewrates),
        ((chosen.parameters, part * sensor.rate) for part in NEXT.rates),
    ):  # fmt: skip
        other = best(others)
        if other is not None and other.widest < NEXT.clearly * chosen.widest:
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
            fit = TraceFit(Experiment.of(self.parameters, self.motion))
            place_runs(fit, [own])
        except (IdentificationError, ParameterError, SolverError):
            return False
        runs = fit.experiment.runs
        late = abs(runs[0].start - self.rest) * self.parameters.drive.frequency
        return [run.steps for run in runs] == [self.steps] and late < NEXT.near


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
            f.frequency <= drive.frequency < NEXT.alike * f.frequency
            and drive.amplitude <= f.amplitude
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
    amplitudes: Sequence[float] = NEXT.amplitudes,
) -> Iterator[Parameters]:
    ringing = Plant.of(free.applied(base, theta)).ringing_frequency
    for part in amplitudes:
        for share in NEXT.frequencies:
            frequency = min(share * ringing, base.drive.max_frequency)
            yield base.replace(amplitude=part * base.actuator.max_voltage, frequency=frequency)


def _loads(p: Parameters, free: FreeParameters, theta: Array) -> Iterator[Parameters]:
    if _OVER_PRELOAD & set(free.names):
        for part in NEXT.preloads:
            yield p.replace(preload=part * p.friction.preload)
    # Few benches have a spring; without the mass, nothing else determines it.
    stiffness = Plant.of(free.applied(p, theta)).contact.sigma_0
    for part in NEXT.springs if "mass" in free.names or p.runner.spring else ():
        yield p.replace(spring=float(f"{part * stiffness:.1g}"))


def candidate_of(
    p: Parameters, free: FreeParameters, theta: Array, sensor: CandidateSensor, rate: float
) -> _Candidate | None:
    """Return a run with its information; None if it cannot be run or sampled."""
    frequency = p.drive.frequency
    record = sensor.samples / rate
    rest = max(NEXT.rest * record, NEXT.least_rest / frequency)
    steps = min(int((record - 2.0 * rest) * frequency), NEXT.most)
    if rate < NEXT.densest * frequency or steps < RECORD.few_steps:
        return None
    t = np.arange(0.0, steps / frequency + 2.0 * rest, 1.0 / rate)
    try:
        own = free.applied(p, theta)
        plant = Plant.of(own)
        decay = (plant.contact.sigma_1 + plant.contact.sigma_2) / (2.0 * plant.mass)
        ringing = Ringing(plant.ringing_frequency, decay) if plant.ringing_frequency else None
        motion = Motion("candidate", t, np.zeros_like(t))
        experiment = Experiment(p, motion, (Stepping(rest, steps, frequency),), ringing)
        x, _ = experiment.simulate(own, np.array([rest]), t)
        noise = sensor.noise * np.random.default_rng(1).standard_normal(len(t))
        motion = Motion("candidate", t, x + noise)
        fit = TraceFit(replace(experiment, motion=motion))
    except (ParameterError, SolverError):
        return None
    fit.noise = Noise(sensor.noise, np.ones(1))
    problem = Problem([fit], replace(free, priors={}))
    point = problem.point(problem.begin(theta))
    if point is None:
        return None
    return _Candidate(p, rate, steps, rest, motion, Profiler(problem, point).information())


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
