# SPDX-License-Identifier: Apache-2.0
"""Step sizes by one regression of all runs and rests of a record.

The rows are means over blocks of time. A block of a run is a part of a settled cycle: each part has
a level of its own, which is the shape of the cycle, and one step from cycle to cycle. A rest has
one level. Jumps of a fringe counter, ringing into the rests, drift and hum are common to all. A
record hardly determines drift and hum, so these have normal priors with a mean of zero (ridge
regression), as wide as usual on a bench. The step is averaged over drifts that are straight, bend,
creep or walk at random, with and without hum of either mains, weighted by how probable these are
(J. Hoeting et al., Statistical Science 14 (1999) 382), with the effective number of rows (C. Geyer,
Statistical Science 7 (1992) 473: the initial positive sequence of the correlation).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.base.arrays import Array
from stickslip_ros.measurement.steps.fold import Rest
from stickslip_ros.measurement.steps.hum import MAINS, USUAL
from stickslip_ros.measurement.steps.measured_value import MeasuredValue
from stickslip_ros.measurement.steps.record import MeanPosition, Record
from stickslip_ros.measurement.steps.ringing import Ringing
from stickslip_ros.measurement.steps.timing import SlipGrid

#: Times of creep that are tried, as parts of the record.
_CREEP_TIMES = (0.003, 0.01, 0.05, 0.3)
#: Times of creep since the first run began, in cycles; highest order of a drift that bends.
_CREEP_CYCLES, _BENDS = (1.0, 10.0), 5
#: Harmonics of the mains; periods of it that a record holds where hum is claimed, and
#: where it is allowed for.
_HARMONICS, _PERIODS, _NUISANCE_PERIODS = (1, 3), 2.0, 0.4
#: How probable hum of either mains, a drift that is not straight, and a random walk are beforehand;
#: how far (m) such a walk gets over the record; waves of its series.
_HUM_ODDS, _BENT_ODDS, _WALK_ODDS = 0.01, 0.02, 0.2
#: Drift beforehand (m/s), as on a bench, and in steps over the record; times of it by which one
#: that bends is tried; creep in an e-fold of time, in steps.
_DRIFT, _DRIFT_STEPS, _BENT, _CREEPS = 3e-7, 0.2, (1.0, 4.0), 0.1
_WALKS, _WAVES = (3e-10, 1e-9, 3e-9, 1e-8, 3e-8, 1e-7), 24
#: Standard errors from which on drift and hum are plainly there; m that a drift comes to, and that
#: hum swings, at least.
_PLAIN, _ADDS_UP, _SWINGS = 5.0, 2e-9, 5e-10
#: Part of a column that others do not have, from which on it is told apart.
_INDEPENDENT = 1e-5
#: Parts of a cycle at most, samples of one at least; rows of a run and of a rest at most.
_PARTS, _SAMPLES, _RUN_ROWS, _REST_ROWS = 8, 3.0, 1500, 200
#: Least change of a step in a short run, whose cycles have not settled, as part of it; how many
#: cycles settle.
_UNSETTLED, _SETTLED = 0.01, 8
#: Differences in a group that show its scatter.
_SCATTER = 3
#: Cycles from which on their motion shows the step; part of a step of fewer by which the rise
#: before a slip may bend; periods before the slip between which the runner rises towards it.
_SHOW_STEP, _BENT_RISE = 3, 0.05
_RISING = (-0.13, -0.08, -0.03)
#: Variances of one mean in a rise that goes on as before: twice the second, less the first.
_OF_TOPS = 5.0
#: Part by which samples far apart miss a step, in squares of their distance in periods: a slip lies
#: anywhere between two of them.
_COARSE = 1.2
#: Precision of positions, m: of the solver of simulated ones, far below any sensor.
PRECISION = 2e-12


@dataclass(frozen=True)
class Disturbances:
    """Drift and hum of a measured position, of the likeliest model."""

    drift: float = 0.0  #: m/s
    drift_error: float = math.inf  #: standard error, m/s
    mains: float | None = None  #: Hz; None: no hum is seen
    waves: tuple[tuple[float, float], ...] = ()  #: sine and cosine (m) of each harmonic
    hum_error: float = math.inf  #: standard error of the amplitude, m

    duration: float = 0.0  #: of the measurement, s

    @property
    def drifts(self) -> bool:
        """Whether the drift is plainly there."""
        clear = abs(self.drift) > _PLAIN * self.drift_error
        return clear and abs(self.drift) * self.duration > _ADDS_UP

    @property
    def hums(self) -> bool:
        """Whether the hum is plainly there."""
        return self.hum > max(_PLAIN * self.hum_error, _SWINGS)

    def at(self, t: Array, drift: bool = True, hum: bool = True) -> Array:
        """Return drift and hum (m) at times (s); the drift counts from the first of them."""
        total = self.drift * (t - t[0]) if drift else np.zeros_like(t)
        return np.asarray(total + self.hum_at(t) if hum else total)

    @property
    def hum(self) -> float:
        """Amplitude of the strongest harmonic, m."""
        return max((math.hypot(*wave) for wave in self.waves), default=0.0)

    def hum_at(self, t: Array, width: Array | float = 0.0) -> Array:
        """Return the hum (m) at times (s), as means over a width (s)."""
        total = np.zeros_like(t)
        if self.mains is not None:
            columns = np.stack(_hum_columns(self.mains, t, width), axis=-1)
            total = columns @ np.ravel(self.waves)
        return np.asarray(total)

    def as_json(self) -> dict[str, float | None]:
        """Return drift (m/s) and hum (Hz, m) with their standard errors; None if unknown."""
        known = math.isfinite(self.drift_error)
        return {
            "position_drift": self.drift if known else None,
            "position_drift_error": self.drift_error if known else None,
            "mains": self.mains,
            "hum": self.hum if self.mains else None,
            "hum_error": self.hum_error if self.mains else None,
        }


@dataclass(frozen=True)
class _Rows:
    """Block means and the columns of the regression that every model has."""

    t: Array  #: middle of each block, s
    width: Array  #: s
    x: Array  #: m
    group: NDArray[np.int64]  #: number of the level that blocks share
    columns: Array  #: cycle numbers of each run; then jumps and ringing
    in_run: NDArray[np.bool_]  #: whether a block is part of a run

    def within_groups(self, values: Array) -> Array:
        """Return values without the mean of their group."""
        group = self.group
        count = np.maximum(np.bincount(group), 1)
        return np.asarray(values - (np.bincount(group, values) / count)[group])


@dataclass(frozen=True)
class _Model:
    """A fit with some of the disturbances."""

    value: Array  # of each column; nan of those it does not have
    covariance: Array  # the diagonal, for a variance of 1
    left: float  # sum of squares
    unknowns: int
    persistence: float
    slow: str = ""
    mains: float | None = None
    places: dict[str, NDArray[np.int64]] = field(default_factory=dict)  # of columns, by name
    odds: float = 0.0  # twice the negative logarithm of its probability beforehand
    volume: float = 0.0  # logarithm of what is known of a walk over its prior
    information: float = 0.0  # the smaller, the likelier

    def informed(self, chance: float) -> _Model:
        """Return the model with its information, by the variance of independent rows (m^2)."""
        return replace(self, information=self.left / chance + self.volume + self.odds)


def fit_steps(
    record: Record,
    mean: MeanPosition,
    grids: Sequence[SlipGrid],
    ringings: Sequence[Ringing | None],
    rests: Sequence[tuple[Rest | None, Rest | None]],
) -> tuple[list[MeasuredValue], Disturbances]:
    """Return the steps (m, with their signs) of runs, and what disturbs the record."""
    rows = _rows_of(record, mean, grids, ringings, rests)
    few = [
        _step_between_rests(mean, grid, pair) if grid.count < _SHOW_STEP else MeasuredValue()
        for grid, pair in zip(grids, rests, strict=True)
    ]
    nothing = few, Disturbances()
    if rows is None:
        return nothing
    weight = _weights(rows, len(grids), record.resolution)
    free = len(rows.x) - int(np.count_nonzero(np.bincount(rows.group)))
    resting = sum(one is not None for pair in rests for one in pair)
    models, chance = _fits(record, rows, weight, grids, resting, free)
    if not models:
        return nothing
    share = _shares(models)
    longest = max((b - a for pair in rests for a, b in filter(None, pair)), default=math.inf)
    drifting = 1.0 if resting else 0.0
    steps = []
    for j, grid in enumerate(grids):
        if grid.count < _SHOW_STEP:
            steps.append(few[j])
            continue
        value = float(sum(p * one.value[j] for p, one in zip(share, models, strict=True)))
        spread = 0.0
        for p, one in zip(share, models, strict=True):
            freedom = max(free / one.persistence - one.unknowns, 1.0)
            own = one.left / max(free - one.unknowns, 1) * one.persistence
            variance = max(chance, own) * float(one.covariance[j]) * (1.0 + 2.0 / freedom)
            spread += p * (variance + (one.value[j] - value) ** 2)
        unsettled = _UNSETTLED * value if grid.count < _SETTLED else 0.0
        coarse = _COARSE * value * (record.spacing / grid.period) ** 2
        # A rest may lie within one step of the converter, which hides a drift.
        hidden = 0.5 * record.resolution * grid.period / longest * drifting
        steps.append(MeasuredValue(value, math.sqrt(spread + unsettled**2 + coarse**2 + hidden**2)))
    best = models[int(np.argmax(share))]
    return steps, _disturbances(best, chance, record.duration)


def _step_between_rests(
    mean: MeanPosition, grid: SlipGrid, rests: tuple[Rest | None, Rest | None]
) -> MeasuredValue:
    """Return the step (m) of one or two cycles: to the last slip from the rest, or from the first.

    The rests beside them show a drift, if there is one.
    """
    before, after = rests
    if before is None or after is None:
        return MeasuredValue()
    t, x, side = [], [], []
    for k, rest in enumerate((before, after)):
        edges = np.linspace(*rest, 65)
        t.append(0.5 * (edges[1:] + edges[:-1]) - grid.last)
        x.append(mean.between(edges[:-1], edges[1:]))
        side.append(np.full(64, float(k)))
    times, place, later = (np.concatenate(one) for one in (t, x, side))
    # Just before the slip, the place of the runner goes on as it went before.
    ends = grid.slips[:, None] + grid.period * np.array(_RISING)
    first, second = mean.between(ends[:, :-1], ends[:, 1:]).T
    tops = second + (second - first)
    # Each top is two means of a few samples, and noise as that of the blocks of the rests.
    block = max(b - a for a, b in (before, after)) / 64.0
    window = grid.period * float(np.diff(_RISING).min())
    of_tops = max(2.0, _OF_TOPS * block / window)
    fits = []
    for slow in ([], [times / float(np.ptp(times))]):
        design = np.column_stack([np.ones_like(later), later, *slow])
        found, *_ = np.linalg.lstsq(design, place, rcond=None)
        left = place - design @ found
        free = max((len(left) - design.shape[1]) / persistence(left), 1.0)
        variance = max(float(left @ left) / free, PRECISION**2)
        error = variance * float(np.linalg.inv(design.T @ design)[0, 0]) * (1.0 + 2.0 / free)
        information = free * math.log(variance) + design.shape[1] * math.log(max(free, 3.0))
        step = float(tops[-1] - found[0])
        if len(tops) > 1:
            rate = float(found[2]) / float(np.ptp(times)) if slow else 0.0
            step = float(tops[-1] - tops[-2]) - rate * grid.period
        fits.append((information, step, error + of_tops * variance))
    least = min(one[0] for one in fits)
    share = np.exp([-0.5 * (one[0] - least) for one in fits])
    share /= share.sum()
    value = float(sum(p * one[1] for p, one in zip(share, fits, strict=True)))
    spread = sum(p * (one[2] + (one[1] - value) ** 2) for p, one in zip(share, fits, strict=True))
    return MeasuredValue(value, math.hypot(math.sqrt(spread), _BENT_RISE * abs(value)))


def _rows_of(
    record: Record,
    mean: MeanPosition,
    grids: Sequence[SlipGrid],
    ringings: Sequence[Ringing | None],
    rests: Sequence[tuple[Rest | None, Rest | None]],
) -> _Rows | None:
    """Return the rows of all runs and rests; None where no run has a settled cycle."""
    begins: list[Array] = []
    ends: list[Array] = []
    numbers: list[Array] = []
    rings: list[tuple[int, float, Ringing]] = []  # group of a rest, begin of its ringing
    for j, grid in enumerate(grids):
        first = max(grid.settling - 1, 0)
        cycles = np.arange(first, grid.count - 1 if grid.count >= _SHOW_STEP else first)
        parts = int(np.clip(grid.period / record.spacing / _SAMPLES, 1, _PARTS))
        cycles = cycles[:: max(1, len(cycles) * parts // _RUN_ROWS)]
        for part in range(parts):
            begin = np.asarray(grid.first + (cycles + part / parts) * grid.period, np.float64)
            begins.append(begin)
            ends.append(begin + grid.period / parts)
            numbers.append(np.where(np.arange(len(grids)) == j, cycles[:, None], 0.0))
    runs = len(begins)
    if not sum(map(len, begins)):
        return None
    seen: set[Rest] = set()
    for grid, ringing, pair in zip(grids, ringings, rests, strict=True):
        for k, rest in enumerate(pair):
            if rest is None or rest in seen:
                continue
            seen.add(rest)
            swing = math.inf if ringing is None else 0.3 * ringing.swing
            width = max(min(grid.period / 8.0, swing), 2.0 * record.spacing)
            count = min(int((rest[1] - rest[0]) / width), _REST_ROWS)
            if count < 2:
                continue
            if k == 1 and count > 8 and ringing is not None:
                rings.append((len(begins), rest[0], ringing))
            edges: Array = np.linspace(*rest, count + 1, dtype=np.float64)
            begins.append(edges[:-1])
            ends.append(edges[1:])
            numbers.append(np.zeros((count, len(grids))))
    begin, end = np.concatenate(begins), np.concatenate(ends)
    group = np.repeat(np.arange(len(begins)), [len(one) for one in begins])
    columns = [np.concatenate(numbers)]
    if record.jumps:
        columns.append(np.sum([
            one.fringes * np.clip((end - one.t) / (end - begin), 0.0, 1.0) for one in record.jumps
        ], axis=0)[:, None])  # fmt: skip
    for number, since, ringing in rings:
        columns.append(_mean_ringing(group == number, begin - since, end - since, ringing))
    return _Rows(
        0.5 * (begin + end), end - begin, mean.between(begin, end), group,
        np.hstack(columns), group < runs,
    )  # fmt: skip


def _mean_ringing(inside: NDArray[np.bool_], begin: Array, end: Array, ringing: Ringing) -> Array:
    """Return the means of cosine and sine of ringing over blocks (s), 0 outside."""
    power = 2j * math.pi * ringing.frequency - ringing.decay
    begin, end = np.where(inside, begin, 0.0), np.where(inside, end, 1.0)
    wave = np.exp(power * begin) * np.expm1(np.where(inside, power * (end - begin), 1.0))
    wave = np.where(inside, wave / (power * (end - begin)), 0.0)
    return np.stack([wave.real, wave.imag], axis=1)


def _hum_columns(mains: float, t: Array, width: Array | float) -> list[Array]:
    return [
        wave(2.0 * math.pi * k * mains * t) * np.sinc(k * mains * np.asarray(width))
        for k in _HARMONICS
        for wave in (np.sin, np.cos)
    ]


def _weights(rows: _Rows, runs: int, resolution: float) -> Array:
    """Return the weights of rows: one over what differs between blocks, beside a step."""
    x, least = rows.x, PRECISION + 0.1 * resolution
    if rows.columns.shape[1] > runs:
        other = np.stack([rows.within_groups(one) for one in rows.columns.T], axis=1)
        found, *_ = np.linalg.lstsq(other, rows.within_groups(x), rcond=None)
        x = np.where(rows.in_run, x, x - rows.columns[:, runs:] @ found[runs:])
    weight = np.ones(len(x))
    neighbours = np.diff(rows.group) == 0
    change, group = np.diff(x)[neighbours], rows.group[1:][neighbours]
    count = np.maximum(np.bincount(group, minlength=1), 1)
    if len(change):
        change = change - (np.bincount(group, change) / count)[group]
        change *= np.sqrt(count / np.maximum(count - 1, 1))[group]
    enough = count[group] >= _SCATTER
    for part in (rows.in_run, ~rows.in_run):
        own = change[part[1:][neighbours] & enough]
        if len(own) > 2:
            weight[part] = 1.0 / max(float(np.std(own)) / math.sqrt(2.0), least)
        else:
            weight[part] = math.nan
    weight[np.isnan(weight)] = np.nanmin(weight) if np.isfinite(weight).any() else 1.0
    return weight / weight.max()


def _fits(
    record: Record,
    rows: _Rows,
    weight: Array,
    grids: Sequence[SlipGrid],
    resting: int,
    free: int,
) -> tuple[list[_Model], float]:
    """Return the fit of each model of slow drift and hum, and the variance (m^2) of free rows.

    resting is the number of rests, free that of rows beyond one a group.
    """
    slow = _slow_columns(record, rows.t, grids) if resting else {}
    fast = {
        mains: _hum_columns(mains, rows.t, rows.width)
        for mains in MAINS
        if record.duration * mains > _NUISANCE_PERIODS
    }
    blocks = {"": list(rows.columns.T), **slow, **{f"{one:g} Hz": fast[one] for one in fast}}
    places: dict[str, NDArray[np.int64]] = {}
    columns: list[Array] = []
    for name, of_block in blocks.items():
        places[name] = np.arange(len(columns), len(columns) + len(of_block))
        columns += [rows.within_groups(one) * weight for one in of_block]
    solver = _Solver(
        np.column_stack(columns), rows.within_groups(rows.x) * weight, rows.t, rows.in_run
    )
    plain = solver.solve(places[""], len(grids))
    if plain is None:
        return [], math.nan
    # A run of two cycles has no settled step of its own.
    step = float(np.nanmax(np.abs(plain.value[: len(grids)]), initial=0.0))
    cases = _slow_cases(record.duration, step) if slow else {"": ((), 1.0)}
    likely, chances = [], []
    for name, (blocks_of_case, odds) in cases.items():
        for mains in (None, *fast):
            sizes = dict(blocks_of_case)
            if mains:
                sizes[f"{mains:g} Hz"] = USUAL / np.repeat(np.array(_HARMONICS, float), 2)
            known = [places[one] for one in sizes]
            found = solver.solve(np.concatenate([places[""], *known]), len(grids))
            if found is not None and free - found.unknowns >= max(0.5 * free, 1.0):
                chances.append(found.left / (free - found.unknowns) * found.persistence)
            odds_of_hum = _HUM_ODDS if mains else 1.0
            likely.append((name, mains, sizes, -2.0 * math.log(odds * odds_of_hum)))
    if not chances:
        found = plain
        chances = [found.left / max(free - found.unknowns, 1) * found.persistence]
    chance = max(min(chances), (PRECISION + 0.1 * record.resolution) ** 2)
    models = []
    for name, mains, sizes, odds in likely:
        index = [places[one] for one in sizes]
        prior = np.concatenate([np.zeros(0), *sizes.values()])
        smooth = np.concatenate([np.zeros(0, np.int64), *index])
        model = solver.solve_smooth(places[""], smooth, prior, chance)
        if model is not None:
            model = replace(model, slow=name, mains=mains, odds=odds, places=places)
            models.append(model.informed(chance))
    return models, chance


def _slow_cases(duration: float, step: float) -> dict[str, tuple[dict[str, Array], float]]:
    """Return the slow drifts that are compared: sizes (m) beforehand by block, and odds."""
    usual = max(_DRIFT * duration, _DRIFT_STEPS * step)
    drift = {"drift": np.array([usual])}
    cases = {"drift": (drift, 1.0)}
    for times in _BENT:
        bend = times * 0.5 * usual * np.ones(_BENDS - 1)
        cases[f"bend {times:g}"] = ({**drift, "bend": bend}, _BENT_ODDS / len(_BENT))
    creeps = [f"creep {one:g}" for one in _CREEP_TIMES]
    creeps += [f"creep of run {one:g}" for one in _CREEP_CYCLES]
    for name in creeps:
        size = np.array([_CREEPS * max(step, 1e-12)])
        cases[name] = ({**drift, name: size}, _BENT_ODDS / len(creeps))
    for far in _WALKS:
        walk = far * math.sqrt(2.0) / (math.pi * (np.arange(_WAVES) + 0.5))
        cases[f"walk {far:g}"] = ({**drift, "walk": walk}, _WALK_ODDS / len(_WALKS))
    return cases


class _Solver:
    """Least squares with some of many columns, all of which are decomposed once."""

    def __init__(self, columns: Array, y: Array, t: Array, in_run: NDArray[np.bool_]) -> None:
        scale = np.sqrt(np.sum(columns * columns, axis=0))
        self._used = scale > 1e-12 * max(float(scale.max()), 1e-30)  # a jump beside all rows is 0
        self._scale = np.where(self._used, scale, 1.0)
        self._columns, self._y = columns / self._scale, y
        count = columns.shape[1]
        both = np.asarray(np.linalg.qr(np.column_stack([self._columns, y]), mode="r"))
        self._r, self._seen = both[:count, :count], both[:count, count]
        self._unseen = float(np.sum(both[count:, count] ** 2))
        self._order = np.argsort(t, kind="stable")
        self._in_run = in_run[self._order]

    def solve(self, columns: NDArray[np.int64], runs: int) -> _Model | None:
        """Return the fit with columns; None where the rows do not tell them apart."""
        index = columns[self._used[columns]]
        q, r = np.linalg.qr(self._r[:, index])
        if not self._used[:runs].any() or len(self._y) <= len(index):
            return None
        if np.abs(np.diag(r)).min() < _INDEPENDENT:
            return None
        inverse = np.linalg.inv(r)
        found = inverse @ (q.T @ self._seen)
        return self._model(index, found, np.sum(inverse**2, axis=1), 0.0, len(index))

    def solve_smooth(
        self, columns: NDArray[np.int64], smooth: NDArray[np.int64], prior: Array, chance: float
    ) -> _Model | None:
        """Return the fit with columns and smooth ones of prior sizes (m); chance: m^2."""
        index = np.concatenate([columns, smooth])
        index = index[self._used[index]]
        free = np.isin(index, columns)
        size = np.full(len(self._scale), math.inf)
        size[smooth] = prior * self._scale[smooth] / math.sqrt(chance)
        r = self._r[:, index]
        tight = np.diag(1.0 / size[index])
        both = np.vstack([r, tight])
        q, own = np.linalg.qr(both)
        if np.abs(np.diag(own)).min() < _INDEPENDENT:
            return None
        inverse = np.linalg.inv(own)
        found = inverse @ (q.T @ np.concatenate([self._seen, np.zeros(len(index))]))
        penalty = float(np.sum((tight @ found) ** 2))
        waves = r[:, ~free] * size[index][~free]
        _, logdet = np.linalg.slogdet(np.eye(waves.shape[1]) + waves.T @ waves)
        model = self._model(index, found, np.sum(inverse**2, axis=1), penalty, int(free.sum()))
        return replace(model, volume=float(logdet))

    def _model(
        self, index: NDArray[np.int64], found: Array, covariance: Array, penalty: float, count: int
    ) -> _Model:
        rest = self._seen - self._r[:, index] @ found
        left = (self._y - self._columns[:, index] @ found)[self._order]
        value = np.full(len(self._scale), math.nan)
        value[index] = found / self._scale[index]
        variance = np.full(len(self._scale), math.nan)
        variance[index] = covariance / self._scale[index] ** 2
        return _Model(
            value,
            variance,
            self._unseen + float(rest @ rest) + penalty,
            count,
            max(persistence(left), persistence(left[self._in_run])),
        )


def _slow_columns(record: Record, t: Array, grids: Sequence[SlipGrid]) -> dict[str, list[Array]]:
    """Return the columns of slow drifts by name: straight, bent, creep from some begin on."""
    since = (t - record.t[0]) / record.duration
    bends = np.polynomial.legendre.legvander(2.0 * since - 1.0, _BENDS).T
    slow = {"drift": [since]}
    slow["bend"] = list(bends[2:])
    slow |= {f"creep {one:g}": [np.log1p(since / one)] for one in _CREEP_TIMES}
    first = min(grids, key=lambda one: one.first)
    driven = np.maximum(t - first.first + first.period, 0.0) / first.period
    slow |= {f"creep of run {one:g}": [np.log1p(driven / one)] for one in _CREEP_CYCLES}
    # The series of Karhunen and Loeve.
    return slow | {"walk": [np.sin(math.pi * (k + 0.5) * since) for k in range(_WAVES)]}


def _shares(models: Sequence[_Model]) -> Array:
    """Return how probable each model is."""
    information = np.array([one.information for one in models])
    share = np.exp(-0.5 * np.minimum(information - information.min(), 600.0))
    return np.asarray(share / share.sum())


def _disturbances(best: _Model, variance: float, duration: float) -> Disturbances:
    error = np.sqrt(np.maximum(variance * best.covariance, 0.0))
    drift, drift_error = 0.0, math.inf
    if best.slow:
        k = best.places["drift"][0]
        drift, drift_error = (float(one[k]) / duration for one in (best.value, error))
    if best.mains is None or duration * best.mains < _PERIODS:
        return Disturbances(drift, drift_error, duration=duration)
    k = best.places[f"{best.mains:g} Hz"]
    waves = tuple((float(a), float(b)) for a, b in best.value[k].reshape(-1, 2))
    return Disturbances(drift, drift_error, best.mains, waves, float(error[k].max()), duration)


def persistence(left: Array) -> float:
    """Return by how much correlation widens the variance of a mean: 1 + 2 sum of correlations."""
    count = len(left)
    if count < 2:
        return 1.0
    spectrum = np.abs(np.fft.rfft(left, 2 * count)) ** 2
    correlation = np.fft.irfft(spectrum)[: max(count // 2, 1)]
    if not correlation[0] > 0.0:
        return 1.0
    even = len(correlation[1:]) // 2
    pairs = correlation[1 : 1 + 2 * even].reshape(-1, 2).sum(axis=1) / correlation[0]
    positive = int(np.argmax(pairs <= 0.0)) if (pairs <= 0.0).any() else len(pairs)
    return float(np.clip(1.0 + 2.0 * pairs[:positive].sum(), 1.0, max(count / 3.0, 1.0)))
