# SPDX-License-Identifier: Apache-2.0
"""From measurements to the parameters of the contact: search, least squares, profiles."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from stickslip_ros.arrays import Array
from stickslip_ros.identification.curve import Curve, CurveFit
from stickslip_ros.identification.effects import effects_of
from stickslip_ros.identification.experiment import (
    Experiment,
    IdentificationError,
    check_record,
    is_too_coarse,
)
from stickslip_ros.identification.fit import Estimate, Fit, FittedRun, Profile, RankedLaw
from stickslip_ros.identification.free import LAG, FreeParameters, Prior, free_parameters
from stickslip_ros.identification.laws import (
    RANKED_LAWS,
    free_of_law,
    rank_laws,
    score_law,
    with_law,
)
from stickslip_ros.identification.least_squares import Point, Problem, descend, descend_from
from stickslip_ros.identification.misfit import misfit_of
from stickslip_ros.identification.profile import BetterOptimum, Profiler
from stickslip_ros.identification.search import clock_of, search
from stickslip_ros.identification.settings import DESCENT, SEARCH
from stickslip_ros.identification.suggestion import CandidateSensor, suggest
from stickslip_ros.identification.trace_fit import CLOCK, RATE, TraceFit
from stickslip_ros.motion.motion import Motion
from stickslip_ros.parameters import ParameterError, Parameters

#: Called with the stage, its progress (0 to 1) and the best values so far.
Progress = Callable[[str, float, Mapping[str, float]], None]


def _silent(what: str, part: float, best: Mapping[str, float]) -> None:
    pass


def identify(
    runs: Sequence[tuple[Parameters | Mapping[str, object], Motion]],
    fit: Sequence[str] | None = None,
    *,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    priors: Mapping[str, Prior] | None = None,
    curves: Sequence[tuple[Parameters | Mapping[str, object], Curve]] = (),
    fit_lag: bool | None = None,
    suggest_next: bool = False,
    laws: Sequence[str] = (),
    seed: int = 1,
    progress: Progress = _silent,
    say: Callable[[str], None] = lambda note: None,
) -> Fit:
    """Find parameters of the contact from measured motions.

    :param runs: for each measurement the parameters of its drive, and the motion. All that is
        known stands in the parameters and is kept; free parameters start at their values there.
    :param fit: names of the free parameters; None: those of the friction law.
    :param bounds: lowest and highest value by name, SI units; None: a factor of 10 about the start.
    :param priors: priors of free parameters, by name.
    :param curves: tables of metrics, with the parameters of the drive that they were measured on.
    :param fit_lag: whether the amplifier may lag (``amplifier_lag``, a time constant in s); None:
        where runs are measured and no set of parameters has an ``amplifier_bandwidth``. An ordinary
        lag of half a microsecond moves ``sigma_0ss`` by more than its interval.
    :param suggest_next: whether to look for the run that would narrow the widest interval most.
    :param laws: friction laws to rank by what they predict, of `identification.RANKED_LAWS`.
    :param seed: of the search, which is random.
    :param progress: called with the stage, its progress and the best values so far.
    :param say: called with each line on what a record and its parameters or fit disagree in, or on
        what the record cannot show; they are among the notes of the fit, too.
    :returns: with ``complete`` False after a KeyboardInterrupt, from the best so far.
    :raises IdentificationError: the measurements show no steps, or a parameter cannot be free.
    :raises ParameterError: the parameters contradict each other.
    """
    if not runs and not curves:
        raise IdentificationError("no measurement was given; give one run or curve at least")
    for name in laws:
        if name not in RANKED_LAWS:
            raise IdentificationError(
                f"{name} is no law to rank; known are {', '.join(RANKED_LAWS)}"
            )
    if laws and not runs:
        raise IdentificationError("laws are ranked by runs that they predict; give one (--run)")
    tables = [CurveFit(Parameters.of(p), curve) for p, curve in curves]
    sets = [Parameters.of(p) for p, _ in runs]
    sets += [p for table in tables for p in table.sets()]
    free = free_parameters(sets, fit, bounds, priors)
    known_lag = any(p.actuator.amplifier_bandwidth is not None for p in sets)
    if fit_lag and known_lag:
        raise IdentificationError(
            "the parameters set amplifier_bandwidth, so a lag of the amplifier cannot be free; "
            "leave it out, or fit no lag (--no-fit-lag)"
        )
    if fit_lag or (fit_lag is None and runs and not known_lag):
        free = free.with_lag()
    for table in tables:
        for name in set(table.curve.varied) & set(free.names):
            raise IdentificationError(f"{table.curve.source} varies {name}, so it cannot be free")
    numbers = sum(table.size for table in tables)
    if not runs and numbers <= len(free.names):
        raise IdentificationError(
            f"{numbers} values are too few to determine {len(free.names)} parameters; "
            "measure more points or free fewer parameters"
        )
    experiments = [Experiment.of(p, motion) for p, (_, motion) in zip(sets, runs, strict=False)]
    notes = [note for one in experiments for note in check_record(one)]
    for note in notes:
        say(note)
    traces = [TraceFit(one) for one in experiments]
    work = _Estimation(traces, tables, free, seed, progress)
    found = work.fit(suggest_next)
    found = replace(found, notes=tuple(notes))
    if experiments and all(is_too_coarse(one, found.base) for one in experiments):
        found = found.without_intervals()
    if not laws or not found.complete:
        return found
    return replace(found, laws=work.rank(laws, bounds or {}, priors or {}))


class _Estimation:
    """One identification on its way; the best so far survives an interruption."""

    def __init__(
        self,
        traces: Sequence[TraceFit],
        tables: Sequence[CurveFit],
        free: FreeParameters,
        seed: int,
        progress: Progress,
    ) -> None:
        self.traces, self.tables = list(traces), list(tables)
        self.free, self.seed, self.progress = free, seed, progress
        self.measured = [one.experiment for one in traces]  # a search may move their starts
        self.problem = Problem([*traces, *tables], free)
        self.searched = free.start
        self.best: Point | None = None

    def fit(self, suggest_next: bool) -> Fit:
        """Return the result, or the best so far if interrupted."""
        profiler: Profiler | None = None
        profiles: list[Profile] = []
        complete = True
        try:
            self._optimum()
            profiler, profiles = self._profiles()
        except KeyboardInterrupt:
            complete = False
        if self.best is None:
            self.best = self.problem.point(self.problem.begin(self.searched))
        if self.best is None:
            raise IdentificationError(
                "the starting values make no contact; change the free parameters' values"
            )
        found = self._estimate_all(self.best, profiler, profiles, complete)
        if profiler is None or not (suggest_next and complete):
            return found
        at = self.best.unknowns
        sensor = CandidateSensor.of(self.traces, [run.noise for run in found.runs])
        base = self.problem.fits[0].parameters
        told = suggest(
            profiler, base, found.parameters, sensor, lambda part: self._report("next", part, at)
        )
        return replace(found, next=told)

    def rank(
        self,
        laws: Sequence[str],
        bounds: Mapping[str, tuple[float, float]],
        priors: Mapping[str, Prior],
    ) -> tuple[RankedLaw, ...]:
        """Return friction laws, the best first; those that make no contact are left out."""
        found = []
        for k, name in enumerate(laws):
            model, more = RANKED_LAWS[name]
            self.progress(f"law {name}", k / len(laws), {})
            work: _Estimation | None = self
            own = self.traces[0].parameters.friction.model == model
            if not own or set(more) - set(self.free.names):
                work = self._with_law(model, more, bounds, priors)
            if work is not None and work.best is not None:
                found.append(score_law(name, work.problem, work.best))
        return rank_laws(found)

    def _with_law(
        self,
        model: str,
        more: Sequence[str],
        bounds: Mapping[str, tuple[float, float]],
        priors: Mapping[str, Prior],
    ) -> _Estimation | None:
        """Return the same measurements with another law at its optimum, None if it has none."""
        try:
            traces = [TraceFit(replace(one, parameters=with_law(one.parameters, model)))
                      for one in self.measured]  # fmt: skip
            tables = [CurveFit(with_law(one.parameters, model), one.curve) for one in self.tables]
        except ParameterError:
            return None
        sets = [one.parameters for one in traces] + [p for one in tables for p in one.sets()]
        free = free_of_law(sets, more, bounds, priors)
        if LAG in self.free.names:
            free = free.with_lag()
        work = _Estimation(traces, tables, free, self.seed, _silent)
        try:
            work._optimum(searches=1)
        except IdentificationError:
            return None
        return work

    def _report(self, what: str, part: float, theta: Array) -> None:
        self.progress(what, part, self.free.values(theta[: len(self.free.names)]))

    def _optimum(self, searches: int = DESCENT.searches) -> None:
        for attempt in range(searches):
            self._search(attempt)
            if self.best is None:
                continue
            self._choose_variants()
            self._learn()
            # A wrong optimum leaves ringing, which no law of noise explains.
            excess = [fit.noise.structure for fit in self.traces]
            if max(excess, default=0.0) < DESCENT.too_much:
                return
        if self.best is None:
            raise IdentificationError(
                "no values between the bounds make a contact; change the bounds, or what is free"
            )

    def _search(self, attempt: int) -> None:
        """Descend from the results of a search; keep the best point."""
        plain = self.free.without_lag()
        # The search is without a lag.
        lag = self.free.start[len(plain.names) :]

        def searched(done: int, of: int, best: Array) -> None:
            self.searched = np.concatenate([best, lag])
            self._report("search", done / of, self.searched)

        before = [fit.starts.copy() for fit in self.traces]
        found_members = search(self.traces, self.tables, plain, self.seed + attempt, searched)
        begins = [np.concatenate([one, lag]) for one in found_members]
        if self.best is not None:  # its clocks count from starts that may have moved
            for k, (fit, old) in enumerate(zip(self.traces, before, strict=True)):
                self.problem.clock(self.best.unknowns, k)[:-1] += (old - fit.starts) / CLOCK
        # The noise may come from a wrong fit; hum is looked for in the residuals of the best point.
        for fit in self.traces:
            fit.forget_noise()
        begun = self._place(begins[0])
        if begun is not None:
            for k, fit in self.problem.traces:
                fit.look_for_hum(begun.seen[k])
        found = []
        if self.best is not None:
            found = [self.problem.point_of(self.best.unknowns, self.best.seen)]
        placed = [(theta, self._place(theta)) for theta in begins]
        starts = [(theta, one) for theta, one in placed if one is not None]

        def descended(done: int, best: Point) -> None:
            self.best = min([*found, best], key=lambda one: one.deviance)
            self._report("descent", done / len(starts), self.best.unknowns)

        ends = descend_from(self.problem, [one for _, one in starts], DESCENT.first, descended)
        self.best = min([*found, *ends], key=lambda one: one.deviance, default=None)

    def _place(self, theta: Array) -> Point | None:
        """Return the model laid over the measurements; None if it makes no contact."""
        unknowns = self.problem.begin(theta)
        try:
            for k, fit in enumerate(self.traces):
                p = self.free.applied(fit.parameters, theta)
                self.problem.clock(unknowns, k)[:] = clock_of(fit, p)
        except ParameterError:
            return None
        return self.problem.point(unknowns)

    def _choose_variants(self) -> None:
        """Choose the runs of the drive if the measurement does not show the rest about them."""
        for fit in self.traces:
            variants = fit.experiment.variants
            if len(variants) == 1:
                continue
            choices: list[tuple[float, Experiment, Point]] = []
            for variant in variants:
                fit.experiment = variant
                if self.best is None:
                    return
                begun = self.problem.point(self.best.unknowns)
                if begun is not None:
                    end = descend(self.problem, begun, DESCENT.first // 3)
                    choices.append((end.deviance, variant, end))
            if choices:
                _, fit.experiment, self.best = min(choices, key=lambda one: one[0])

    def _learn(self) -> None:
        """Estimate the noise from the residuals, and descend with it."""
        for k in range(DESCENT.learnt):
            if self.best is None:
                return
            for one, seen in zip(self.problem.fits, self.best.seen, strict=True):
                one.learn_noise(seen)
            begun = self.problem.point_of(self.best.unknowns, self.best.seen)
            self.best = descend(self.problem, begun, DESCENT.then)
            self._report("noise", (k + 1) / DESCENT.learnt, self.best.unknowns)

    def _profiles(self) -> tuple[Profiler, list[Profile]]:
        for attempt in range(DESCENT.again + 1):
            assert self.best is not None
            profiler = Profiler(self.problem, self.best, stops=attempt < DESCENT.again)
            profiles: list[Profile] = []
            try:
                for k, name in enumerate(self.free.names):
                    self._report(
                        f"interval of {name}", k / len(self.free.names), self.best.unknowns
                    )
                    profiles.append(profiler.profile(k))
            except BetterOptimum as better:
                self.best = descend(self.problem, better.point, DESCENT.first)
                self._learn()
            else:
                break
        return profiler, profiles

    def _estimate_all(
        self, best: Point, profiler: Profiler | None, profiles: Sequence[Profile], complete: bool
    ) -> Fit:
        theta = best.unknowns[: len(self.free.names)]
        ends = {one.name: (one.low, one.high) for one in profiles}
        effects = effects_of(self.problem, best) if complete else []
        misfit = misfit_of(self.problem, best, effects) if complete else None
        estimates = {}
        for k, (name, value) in enumerate(self.free.values(theta).items()):
            gap = min(theta[k] - self.free.low[k], self.free.high[k] - theta[k])
            doubt = "misfit" if misfit else ""
            if gap < SEARCH.on_bound and name != LAG:  # an amplifier may well not lag
                doubt = "on a bound of the search"
            estimates[name] = Estimate(name, value, *ends.get(name, (None, None)), doubt)
        matrix = profiler.correlations() if profiler else None
        names = self.free.names
        correlations = {
            a: {b: float(matrix[i, j]) for j, b in enumerate(names)} for i, a in enumerate(names)
        } if matrix is not None else {}  # fmt: skip
        free = self.free
        if LAG in estimates and estimates[LAG].low is None:  # its interval does not exclude 0
            free, theta = free.without_lag(), theta[:-1]
        given = [f"{one.effect.tenth} would not show: {one.given}" for one in effects if one.given]
        return Fit(
            parameters=estimates,
            base=free.applied(self.problem.fits[0].parameters, theta),
            correlations=correlations,
            unknown=tuple(profiler.unknown()) if profiler else (),
            given=tuple(given),
            runs=tuple(self._run(best, k) for k in range(len(self.traces))),
            curves=tuple(
                one.fitted(best.seen[len(self.traces) + k]) for k, one in enumerate(self.tables)
            ),
            profiles=tuple(profiles),
            misfit=misfit,
            complete=complete,
        )

    def _run(self, best: Point, k: int) -> FittedRun:
        fit, seen, clock = self.traces[k], best.seen[k], self.problem.clock(best.unknowns, k)
        left = fit.unprojected(seen)
        kept = fit.kept > 0.0
        scaled = left[kept] * np.sqrt(fit.bins.count[kept])
        return FittedRun(
            source=fit.experiment.motion.source,
            start=float(fit.starts[0] + CLOCK * clock[0]),
            steps=sum(run.steps for run in fit.experiment.runs),
            clock_drift=float(RATE * clock[-1]),
            noise=float(np.sqrt(np.mean(scaled**2))),
            residual=float(np.sqrt(np.mean(left[kept] ** 2))),
            mains=fit.mains,
            cycle=fit.cycles(clock),
            t=fit.bins.t,
            measured=fit.bins.x,
            left=left,
        )
