# SPDX-License-Identifier: Apache-2.0
"""From measurements to the parameters of the contact: search, least squares, intervals."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from stickslip_ros.base.arrays import Array
from stickslip_ros.measurement.identification.curve import Curve, CurveFit
from stickslip_ros.measurement.identification.effects import effects_of
from stickslip_ros.measurement.identification.experiment import (
    Experiment,
    IdentificationError,
    check_record,
    is_too_coarse,
)
from stickslip_ros.measurement.identification.fit import Estimate, Fit, FittedRun, Profile
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
from stickslip_ros.measurement.identification.inputs import Known, known_runs
from stickslip_ros.measurement.identification.intervals import BetterOptimum, Span, Surroundings
from stickslip_ros.measurement.identification.misfit import misfit_of
from stickslip_ros.measurement.identification.problem import Point, Problem
from stickslip_ros.measurement.identification.search import clock_of, search
from stickslip_ros.measurement.identification.trace import CLOCK, RATE, Trace
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
    work = _Estimation([Trace(one) for one in experiments], tables, free, nuisances, seed, progress)
    found = replace(work.fit(), notes=tuple(notes))
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


class _Estimation:
    """One identification on its way; the best so far survives an interruption."""

    def __init__(
        self,
        traces: Sequence[Trace],
        tables: Sequence[CurveFit],
        free: FreeParameters,
        nuisances: Sequence[Nuisance],
        seed: int,
        progress: Progress,
    ) -> None:
        self.traces, self.tables = list(traces), list(tables)
        self.free, self.seed, self.progress = free, seed, progress
        self.problem = Problem([*traces, *tables], free, nuisances)
        self.searched = free.start
        self.best: Point | None = None

    def fit(self) -> Fit:
        """Return the result, or the best so far if interrupted."""
        around: Surroundings | None = None
        spans: list[Span] = []
        with contextlib.suppress(KeyboardInterrupt):
            self.find_optimum()
            around, spans = self._spans(self._surroundings())
        if self.best is None:
            self.best = self.problem.point(self.problem.begin(self.searched))
        if self.best is None:
            raise IdentificationError(
                "the starting values make no contact; change the free parameters' values"
            )
        return self._estimate_all(around, spans)

    def _report(self, what: str, part: float, theta: Array) -> None:
        self.progress(what, part, self.free.values(theta[: len(self.free.names)]))

    # -- the optimum

    def find_optimum(self) -> None:
        """Search, descend and learn the noise. IdentificationError."""
        for attempt in range(_SEARCHES):
            self._search(attempt)
            if self.best is None:
                continue
            self._choose_variants()
            self._learn()
            measured = sum(trace.known for trace in self.traces)
            if self.best.deviance < _BAD * max(measured, 1):
                return
        if self.best is None:
            raise IdentificationError(
                "no values between the bounds make a contact; change the bounds, or what is free"
            )

    def _search(self, attempt: int) -> None:
        """Descend from the results of a search; keep the best point."""

        def searched(part: float, best: Array) -> None:
            self.searched = best
            self._report("search", part, best)

        begins = search(self.traces, self.tables, self.free, self.seed + attempt, searched)
        ends = [] if self.best is None else [self.best]
        for k, theta in enumerate(begins):
            begun = self.problem.point(self._begin(theta))
            if begun is not None:
                ends.append(self.problem.descend(begun, _FIRST))
                self.best = min(ends, key=lambda one: one.deviance)
                self._report("descent", (k + 1) / len(begins), self.best.unknowns)
        if self.best is not None:
            self.best = self.problem.descend(self.best, _THEN)

    def _begin(self, theta: Array) -> Array:
        """Return unknowns with the model laid over the measurements."""
        unknowns = self.problem.begin(theta)
        for k, trace in enumerate(self.traces):
            p = self.free.applied_or_none(trace.parameters, theta)
            if p is not None:
                self.problem.clock(unknowns, k)[:] = clock_of(trace, p)
        return unknowns

    def _choose_variants(self) -> None:
        """Choose the runs of the drive if the measurement does not show the rest about them."""
        for trace in self.traces:
            variants = trace.experiment.variants
            if len(variants) == 1 or self.best is None:
                continue
            choices: list[tuple[float, Experiment, Point]] = []
            for variant in variants:
                trace.experiment = variant
                begun = self.problem.point(self.best.unknowns)
                if begun is not None:
                    end = self.problem.descend(begun, _VARIANT)
                    choices.append((end.deviance, variant, end))
            if choices:
                _, trace.experiment, self.best = min(choices, key=lambda one: one[0])

    def _learn(self) -> None:
        """Estimate the noise from the residuals, and descend with it."""
        for k in range(_TIMES):
            if self.best is None:
                return
            for one, seen in zip(self.problem.fits, self.best.seen, strict=True):
                one.learn(seen)
            begun = self.problem.point_of(self.best.unknowns, self.best.seen)
            self.best = self.problem.descend(begun, _LEARNT)
            self._report("noise", (k + 1) / _TIMES, self.best.unknowns)

    # -- the intervals

    def _surroundings(self) -> Surroundings:
        """Return what is known about the optimum; a better one that is met takes its place."""
        for attempt in range(_AGAIN + 1):
            assert self.best is not None
            self._report("intervals", attempt / (_AGAIN + 1), self.best.unknowns)
            try:
                return Surroundings(self.problem, self.best, stops=attempt < _AGAIN)
            except BetterOptimum as better:
                self.best = self.problem.descend(better.point, _THEN)
                self._learn()
        raise AssertionError("the last one does not stop")

    def _spans(self, around: Surroundings) -> tuple[Surroundings, list[Span]]:
        """Return the intervals, and the surroundings of the fit that the values are of.

        A lag, or a width, is never below 0, so that a free one that is not there moves all values
        one way. Where none shows, the values are those without, and the intervals hold both.
        """
        spans = [around.span(k) for k in range(self.problem.count)]
        hidden = [one.name for one in self.problem.nuisances if one.name in (LAG, WIDTH)]
        if not hidden or self.best is None:
            return around, spans
        self._report("intervals", 0.5, self.best.unknowns)
        for names in ([], *([[one] for one in hidden] if len(hidden) > 1 else [])):
            plain = self.problem.without([one for one in hidden if one not in names])
            begun = plain.point(self._of(plain, self.best.unknowns))
            if begun is None:
                continue
            end = plain.descend(begun, _LEARNT)
            shows = (end.deviance - self.best.deviance) / around.scale
            if shows < _SHOWS[len(hidden) - len(names)]:
                other = Surroundings(plain, end, stops=False)
                own = [other.span(k) for k in range(plain.count)]
                joined = [one.joined(two) for one, two in zip(own, spans, strict=True)]
                return other, joined
        return around, spans

    def _of(self, plain: Problem, unknowns: Array) -> Array:
        """Return the unknowns of a problem that lacks some nuisances of this one."""
        lacks = [k for k, one in enumerate(self.problem.nuisances, self.problem.count)
                 if one not in plain.nuisances]  # fmt: skip
        return np.delete(unknowns, lacks)

    def _estimate_all(self, around: Surroundings | None, spans: Sequence[Span]) -> Fit:
        best = around.best if around else self.best
        problem = around.problem if around else self.problem
        assert best is not None
        allowed = [one.name for one in self.problem.nuisances]
        effects = effects_of(around, allowed) if around else []
        misfit = misfit_of(around, effects) if around else None
        estimates = {}
        for k, name in enumerate(self.free.names):
            at = float(best.unknowns[k])
            ends = (spans[k].low, spans[k].high) if spans else (None, None)
            low, high = (None if end is None else math.exp(end) for end in ends)
            doubt = "misfit" if misfit else ""
            if min(at - problem.low[k], problem.high[k] - at) < _ON_BOUND:
                doubt = "on a bound of the search"
            estimates[name] = Estimate(name, math.exp(at), low, high, doubt)
        estimates |= self._hidden(around, best, problem)
        names = self.free.names
        matrix = around.correlations() if around else None
        correlations = {
            a: {b: float(matrix[i, j]) for j, b in enumerate(names)} for i, a in enumerate(names)
        } if matrix is not None else {}  # fmt: skip
        base = self.free.applied(problem.fits[0].parameters, best.unknowns[: problem.count])
        lag = estimates.get(LAG)
        if lag is not None and lag.low:  # an interval that excludes 0
            base = base.replace(amplifier_bandwidth=1.0 / (2.0 * math.pi * lag.value))
        profiles: list[Profile] = []
        if around is not None:
            profiles = [around.profile(k) for k in range(problem.count)]
        return Fit(
            parameters=estimates,
            base=base,
            correlations=correlations,
            deviance=best.deviance + sum(fit.loudness for fit in problem.fits),
            unknown=tuple(around.unknown()) if around else (),
            given=tuple(one.given for one in effects if one.given),
            runs=tuple(self._run(problem, best, k) for k in range(len(self.traces))),
            curves=tuple(one.fitted(best.seen[len(self.traces) + k])
                         for k, one in enumerate(self.tables)),
            profiles=tuple(profiles),
            misfit=misfit,
            complete=around is not None,
        )  # fmt: skip

    def _hidden(
        self, around: Surroundings | None, best: Point, problem: Problem
    ) -> dict[str, Estimate]:
        """Return lag and width with their intervals, 0 where they do not show."""
        found = {}
        for one in self.problem.nuisances:
            if one.name not in (LAG, WIDTH):
                continue
            scale, root = (1e-6, 1.0) if one.name == LAG else (1e-6, 0.5)
            k = problem.number(one.name)
            value = 0.0 if k is None else float(best.unknowns[k])
            low = high = None
            if around is not None:
                whole, j = self.best, self.problem.number(one.name)
                assert whole is not None and j is not None
                spread = 1.96 * self._deviation(j)
                high = scale * max(float(whole.unknowns[j]) + spread, 0.0) ** root
                low = scale * max(value - spread, 0.0) ** root or None
            found[one.name] = Estimate(one.name, scale * value**root, low, high)
        return found

    def _deviation(self, k: int) -> float:
        """Return the standard deviation of a nuisance at the optimum with all of them."""
        assert self.best is not None
        jacobian = self.problem.jacobian(self.best)
        return float(np.sqrt(self.problem.covariance(jacobian)[k, k]))

    def _run(self, problem: Problem, best: Point, k: int) -> FittedRun:
        trace, seen, clock = self.traces[k], best.seen[k], problem.clock(best.unknowns, k)
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
