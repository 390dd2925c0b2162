# SPDX-License-Identifier: Apache-2.0
"""From measurements to the parameters of the contact: search, least squares, intervals."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from stickslip_ros.base.arrays import Array
from stickslip_ros.base.reporting import CONFIDENCE
from stickslip_ros.measurement.identification.curve import Curve, CurveFit
from stickslip_ros.measurement.identification.experiment import (
    Experiment,
    IdentificationError,
    check_record,
    is_too_coarse,
)
from stickslip_ros.measurement.identification.fit import Estimate, Fit, FittedRun
from stickslip_ros.measurement.identification.free import (
    LAG,
    WIDTH,
    FreeParameters,
    Nuisance,
    Prior,
    free_parameters,
    lag_of_amplifier,
    uncertain_input,
    width_of_sensor,
)
from stickslip_ros.measurement.identification.intervals import BetterOptimum, Span, Surroundings
from stickslip_ros.measurement.identification.known import Known, known_runs
from stickslip_ros.measurement.identification.misfit import effects_of, misfit_of
from stickslip_ros.measurement.identification.problem import Point, Problem
from stickslip_ros.measurement.identification.search import clock_of, search
from stickslip_ros.measurement.identification.trace import CLOCK, RATE, Seen, Trace
from stickslip_ros.physics.parameters import Parameters

#: Called with the stage, its progress (0 to 1) and the best values so far.
Progress = Callable[[str, float, Mapping[str, float]], None]
#: How an instrument samples.
SAMPLES = ("point", "mean")
#: Rounds of descents: from each start, from the best, with the noise learnt; times of that.
_FIRST, _THEN, _LEARNT, _TIMES = 6, 20, 15, 2
#: Rounds of a descent that tells two possible runs of the drive apart.
_VARIANT = 6
#: Times that a better optimum is taken up; fall of the deviance from which on a lag or a width is
#: there (1 % by chance, of one unknown or two).
_AGAIN, _SHOWS = 2, {1: 6.63, 2: 9.21}
#: Deviance a residual from which on another search is worth it; searches at most.
_BAD, _SEARCHES = 4.0, 2
#: Distance (logarithm) that counts as on a bound.
_ON_BOUND = 1e-3


def _silent(what: str, part: float, best: Mapping[str, float]) -> None:
    pass


def identify(
    runs: Sequence[Any],
    fit: Sequence[str] | None = None,
    *,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    priors: Mapping[str, Prior] | None = None,
    curves: Sequence[tuple[Parameters | Mapping[str, object], Curve]] = (),
    uncertain: Mapping[str, float] | None = None,
    samples: str | None = None,
    fit_lag: bool | None = None,
    seed: int = 1,
    progress: Progress = _silent,
    say: Callable[[str], None] = lambda note: None,
) -> Fit:
    """Find parameters of the contact from measured motions.

    :param runs: for each measurement (drive, motion) or (drive, t, x). A drive is a parameter file,
        a mapping or Parameters. All that is known stands there and is kept, but for numbers with a
        standard deviation, ``"0.4 +- 0.02"``; free parameters start at their values there. A motion
        is a Motion, a file, a DataFrame or an xarray object with units, t (s) and x (m) are arrays.
    :param fit: names of the free parameters; None: those of the friction law.
    :param bounds: lowest and highest value by name, SI units; None: what ringing and stroke leave
        constants of the contact, a factor of 10 about the start for others.
    :param priors: priors of free parameters, by name.
    :param curves: tables of metrics, with the parameters of the drive that they were measured on.
    :param uncertain: standard deviations by name, SI units, of inputs that all runs share.
    :param samples: "point" if samples are of an instant, "mean" if they are means over the time
        from one to the next; None: not known, so intervals allow for what such a width, or an
        unknown bandwidth of the sensor, would move.
    :param fit_lag: whether the amplifier may lag (``amplifier_lag``, a time constant in s); None:
        where runs are measured and no set of parameters has an ``amplifier_bandwidth``. An ordinary
        lag of half a microsecond moves ``sigma_0ss`` by more than its interval.
    :param seed: of the search, which is random.
    :param progress: called with the stage, its progress and the best values so far.
    :param say: called with each line on what a record and its parameters or fit disagree in, or on
        what the record cannot show; they are among the notes of the fit, too.
    :returns: with ``complete`` False after a KeyboardInterrupt, from the best so far.
    :raises IdentificationError: the measurements show no steps, or none that the drive can make, a
        parameter cannot be free, or an argument is of another form.
    :raises ParameterError: the parameters contradict each other.
    :raises MeasurementError: a file cannot be read.
    """
    if not isinstance(runs, str | Mapping) and not len(runs) and not curves:
        raise IdentificationError("no measurement was given; give one run or curve at least")
    if samples not in (None, *SAMPLES):
        raise IdentificationError(f"samples is {samples!r}; it has to be {' or '.join(SAMPLES)}")
    measured = known_runs(runs)
    known_curves = [Known.of(p) for p, _ in curves]
    tables = [CurveFit(one.parameters, curve)
              for one, (_, curve) in zip(known_curves, curves, strict=True)]  # fmt: skip
    sets = [one.parameters for one, _ in measured] + [p for table in tables for p in table.sets()]
    free_parameters(sets, fit, bounds, priors)  # refused before records are looked at
    lagging = _may_lag(sets, fit_lag, bool(measured))
    inputs = _inputs([*(one for one, _ in measured), *known_curves], uncertain or {})
    experiments = [Experiment.of(one.parameters, motion, samples) for one, motion in measured]
    free = free_parameters(sets, fit, bounds, priors, experiments)
    _check_tables(tables, free, bool(measured))
    nuisances = [one for one in inputs if one.name not in free.names]
    if lagging:
        nuisances.append(lag_of_amplifier())
    if experiments and samples is None and not any(p.sensor.sensor_bandwidth for p in sets):
        nuisances.append(width_of_sensor(max(one.motion.spacing for one in experiments)))
    notes = [note for one in experiments for note in check_record(one)]
    for note in notes:
        say(note)
    problem = Problem([*map(Trace, experiments), *tables], free, nuisances)
    found = replace(_fit(problem, seed, progress), notes=tuple(notes))
    if experiments and all(is_too_coarse(one, found.base) for one in experiments):
        found = found.without_intervals()
    return found


def _may_lag(sets: Sequence[Parameters], fit_lag: bool | None, measured: bool) -> bool:
    """Return whether the lag of the amplifier is fitted. IdentificationError."""
    known = any(p.actuator.amplifier_bandwidth is not None for p in sets)
    if fit_lag and known:
        raise IdentificationError(
            "the parameters set amplifier_bandwidth, so a lag of the amplifier cannot be free; "
            "leave it out, or fit no lag (--no-fit-lag)"
        )
    return bool(fit_lag) or (fit_lag is None and measured and not known)


def _inputs(known: Sequence[Known], uncertain: Mapping[str, float]) -> list[Nuisance]:
    """Return the uncertain inputs, each alike in all runs, with its largest relative deviation."""
    parts: dict[str, float] = {}
    for one in known:
        for name, part in one.parts(uncertain).items():
            parts[name] = max(part, parts.get(name, 0.0))
    return [uncertain_input(name, part) for name, part in parts.items()]


def _check_tables(tables: Sequence[CurveFit], free: FreeParameters, measured: bool) -> None:
    """Raise IdentificationError for tables that cannot tell what is free."""
    for table in tables:
        for name in set(table.curve.varied) & set(free.names):
            raise IdentificationError(f"{table.curve.source} varies {name}, so it cannot be free")
    numbers = sum(table.size for table in tables)
    if not measured and numbers <= len(free.names):
        raise IdentificationError(
            f"{numbers} values are too few to determine {len(free.names)} parameters; "
            "measure more points or free fewer parameters"
        )


def _fit(problem: Problem, seed: int, progress: Progress) -> Fit:
    """Return the result, or the best so far if interrupted. IdentificationError."""
    best: Point | None = None
    whole: Surroundings | None = None
    around: Surroundings | None = None
    spans: list[Span] = []
    searched = problem.free.start

    def follow(part: float, theta: Array) -> None:
        nonlocal searched
        searched = theta
        progress("search", part, problem.free.values(theta))

    with contextlib.suppress(KeyboardInterrupt):
        for what, part, point in _optimum(problem, seed, follow):
            best = point
            progress(what, part, problem.free.values(best.unknowns))
        assert best is not None
        whole = _surroundings(problem, best, progress)
        around, spans = _without_hidden(whole)
    if best is None:
        best = problem.point(problem.begin(searched))
    if best is None:
        raise IdentificationError(
            "the starting values make no contact; change the free parameters' values"
        )
    return _result(problem, best, whole, around, spans)


# -- the optimum


def _optimum(
    problem: Problem, seed: int, follow: Callable[[float, Array], None]
) -> Iterator[tuple[str, float, Point]]:
    """Search, descend and learn the noise; yield stage, its part and the best so far.

    The last is the optimum. Raises IdentificationError.
    """
    best: Point | None = None
    measured = sum(trace.known for trace in problem.traces)

    for attempt in range(_SEARCHES):
        begins = search(problem, seed + attempt, follow)
        for k, theta in enumerate(begins, 1):
            begun = problem.point(_laid_over(problem, theta))
            if begun is not None:
                end = problem.descend(begun, _FIRST)
                best = end if best is None or end.deviance < best.deviance else best
                yield "descent", k / len(begins), best
        if best is None:
            continue
        best = _with_variants(problem, problem.descend(best, _THEN))
        for part in range(1, _TIMES + 1):
            best = _learnt(problem, best)
            yield "noise", part / _TIMES, best
        if best.deviance < _BAD * max(measured, 1):
            return
    if best is None:
        raise IdentificationError(
            "no values between the bounds make a contact; change the bounds, or what is free"
        )


def _laid_over(problem: Problem, theta: Array) -> Array:
    """Return unknowns with the model laid over the measurements."""
    unknowns = problem.begin(theta)
    for k, trace in enumerate(problem.traces):
        p = problem.free.applied_or_none(trace.parameters, theta)
        if p is not None:
            problem.clock(unknowns, k)[:] = clock_of(trace, p)
    return unknowns


def _with_variants(problem: Problem, best: Point) -> Point:
    """Choose the runs of the drive if the measurement does not show the rest about them."""
    for trace in problem.traces:
        variants, choices = trace.experiment.variants, []
        for variant in variants if len(variants) > 1 else []:
            trace.experiment = variant
            begun = problem.point(best.unknowns)
            if begun is not None:
                choices.append((problem.descend(begun, _VARIANT), variant))
        if choices:
            best, trace.experiment = min(choices, key=lambda one: one[0].deviance)
    return best


def _learnt(problem: Problem, best: Point) -> Point:
    """Estimate the noise from the residuals, and descend with it."""
    for one, seen in zip(problem.fits, best.seen, strict=True):
        one.learn(seen)
    return problem.descend(problem.point_of(best.unknowns, best.seen), _LEARNT)


# -- the intervals


def _surroundings(problem: Problem, best: Point, progress: Progress) -> Surroundings:
    """Return what is known about the optimum, or about a better one that is met."""
    for attempt in range(_AGAIN):
        progress("intervals", attempt / (_AGAIN + 1), problem.free.values(best.unknowns))
        try:
            return Surroundings(problem, best)
        except BetterOptimum as better:
            best = problem.descend(better.point, _THEN)
            for _ in range(_TIMES):
                best = _learnt(problem, best)
    return Surroundings(problem, best, stops=False)


def _without_hidden(around: Surroundings) -> tuple[Surroundings, list[Span]]:
    """Return the surroundings of the fit that the values are of, and the intervals.

    A lag, or a width, is never below 0, so that a free one that is not there moves all values one
    way. Where none shows, the values are those without, and the intervals hold both.
    """
    problem, best = around.problem, around.best
    spans = [around.span(k) for k in range(problem.count)]
    hidden = [one.name for one in problem.nuisances if one.name in (LAG, WIDTH)]
    for kept in ([], *([[one] for one in hidden] if len(hidden) > 1 else [])) if hidden else ():
        plain = problem.without([one for one in hidden if one not in kept])
        lacks = [k for k, one in enumerate(problem.nuisances, problem.count)
                 if one not in plain.nuisances]  # fmt: skip
        begun = plain.point(np.delete(best.unknowns, lacks))
        if begun is None:
            continue
        end = plain.descend(begun, _LEARNT)
        if (end.deviance - best.deviance) / around.scale < _SHOWS[len(lacks)]:
            other = Surroundings(plain, end, stops=False)
            own = [other.span(k) for k in range(plain.count)]
            return other, [one.joined(two) for one, two in zip(own, spans, strict=True)]
    return around, spans


# -- the result


def _result(
    problem: Problem,
    best: Point,
    whole: Surroundings | None,
    around: Surroundings | None,
    spans: Sequence[Span],
) -> Fit:
    """Return the fit: around are the surroundings of its values, whole those with all unknowns."""
    names, allowed = problem.free.names, [one.name for one in problem.nuisances]
    shown, best = (around.problem, around.best) if around else (problem, best)
    effects = effects_of(around, allowed) if around else []
    misfit = misfit_of(around, effects) if around else None
    estimates = {}
    for k, name in enumerate(names):
        at = float(best.unknowns[k])
        ends = (spans[k].low, spans[k].high) if spans else (None, None)
        low, high = (None if end is None else math.exp(end) for end in ends)
        doubt = "misfit" if misfit else ""
        if min(at - shown.low[k], shown.high[k] - at) < _ON_BOUND:
            doubt = "on a bound of the search"
        estimates[name] = Estimate(name, math.exp(at), low, high, doubt)
    for name in allowed:
        if name in (LAG, WIDTH):
            estimates[name] = _hidden(name, whole, shown.value(name, best.unknowns))
    matrix = around.correlations() if around else np.zeros((0, 0))
    base = shown.free.applied(shown.fits[0].parameters, best.unknowns[: shown.count])
    lag = estimates.get(LAG)
    if lag is not None and lag.low:  # an interval that excludes 0
        base = base.replace(amplifier_bandwidth=1.0 / (2.0 * math.pi * lag.value))
    numbered = list(enumerate(shown.fits))
    return Fit(
        parameters=estimates,
        base=base,
        correlations={
            a: dict(zip(names, row, strict=True))
            for a, row in zip(names, matrix.tolist(), strict=False)
        },
        deviance=best.deviance + sum(fit.loudness for fit in shown.fits),
        unknown=tuple(around.unknown()) if around else (),
        given=tuple(one.given for one in effects if one.given),
        runs=tuple(_run(one, best.seen[k], shown.clock(best.unknowns, k))
                   for k, one in numbered if isinstance(one, Trace)),
        curves=tuple(one.fitted(best.seen[k]) for k, one in numbered if isinstance(one, CurveFit)),
        profiles=tuple(around.profile(k) for k in range(shown.count)) if around else (),
        misfit=misfit,
        complete=around is not None,
    )  # fmt: skip


def _hidden(name: str, whole: Surroundings | None, value: float) -> Estimate:
    """Return lag or width (0 where it does not show) with the interval of the fit with both."""
    root, low, high = 1.0 if name == LAG else 0.5, None, None
    if whole is not None:
        best, k = whole.best, whole.problem.number(name)
        covariance = whole.problem.covariance(whole.problem.jacobian(best))
        spread = CONFIDENCE * math.sqrt(covariance[k, k])
        high = 1e-6 * max(float(best.unknowns[k]) + spread, 0.0) ** root
        low = 1e-6 * max(value - spread, 0.0) ** root or None
    return Estimate(name, 1e-6 * value**root, low, high)


def _run(trace: Trace, seen: Seen, clock: Array) -> FittedRun:
    left, full = trace.left(seen), trace.blocks.full
    residual = float(np.sqrt(np.mean(left[full] ** 2)))
    return FittedRun(
        source=trace.experiment.motion.source,
        start=float(trace.starts[0] + CLOCK * clock[0]),
        steps=trace.experiment.steps,
        clock_drift=float(RATE * clock[-1]),
        noise=residual * math.sqrt(trace.blocks.count),
        residual=residual,
        mains=trace.mains,
        cycle=np.where(full, trace.cycles(clock), np.nan),
        t=trace.blocks.t,
        measured=trace.blocks.x,
        left=left,
    )
