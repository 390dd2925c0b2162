# SPDX-License-Identifier: Apache-2.0
"""Step sizes by one regression of all runs and rests of a record.

The rows are means over blocks of time. A block of a run is a part of a settled cycle: each part has
a level of its own, which is the shape of the cycle, and one step from cycle to cycle. A rest has
one level; those beside a run of one or two cycles differ by its steps. Jumps of a fringe counter,
ringing into the rests, drift and hum are common to all. A record hardly determines drift and hum,
so these have normal priors with a mean of zero (ridge regression), as wide as usual on a bench. The
step is averaged over drifts that are straight, bend or walk at random, with and without hum of
either mains, weighted by how probable these are (J. Hoeting et al., Statistical Science 14 (1999)
382), with the effective number of rows (C. Geyer, Statistical Science 7 (1992) 473: the initial
positive sequence of the correlation). Steps that change within a run are told by the same
comparison.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.base.arrays import Array
from stickslip_ros.measurement.steps.disturbances import (
    HARMONICS,
    MAINS,
    Change,
    Disturbances,
    hum_columns,
)
from stickslip_ros.measurement.steps.fold import Rest, way_between
from stickslip_ros.measurement.steps.record import MeanPosition, Record
from stickslip_ros.measurement.steps.ringing import Ringing
from stickslip_ros.measurement.steps.run import MeasuredValue
from stickslip_ros.measurement.steps.settings import SETTINGS
from stickslip_ros.measurement.steps.slips import SlipGrid

#: Prior standard deviation of the fundamental, m; that of harmonic n is n times smaller.
_USUAL = 2e-8
#: How probable hum of either mains, a drift that bends, a random walk and a change of the steps are
#: beforehand.
_HUM_ODDS, _BENT_ODDS, _WALK_ODDS, _CHANGE_ODDS = 0.01, 0.02, 0.2, 0.01
#: Drift beforehand (m/s), as on a bench, and in steps over the record; part of a step by which it
#: changes; times a drift by which one bends, and the highest order of such a one; how far (m) a
#: walk gets over the record; waves of its series (of Karhunen and Loeve).
_DRIFT, _DRIFT_STEPS, _CHANGES, _BENT, _BENDS = 3e-7, 0.2, 0.1, (0.1, 1.0, 4.0), 5
_WALKS, _WAVES = (3e-10, 1e-9, 3e-9, 1e-8, 3e-8, 1e-7), 24
#: Cycles from which on a change is looked for, and places in a run where it is.
_MANY, _PLACES = 12, 9
#: Part of a column that others do not have, from which on it is told apart.
_INDEPENDENT = 1e-5
#: Parts of a cycle at most, samples of one at least; rows of a run and of a rest at most.
_PARTS, _SAMPLES, _RUN_ROWS, _REST_ROWS = 8, 3.0, 1500, 200
#: Cycles from which on their motion shows the step.
_SHOW_STEP = 3
#: Least change of a step in a short run, whose cycles have not settled, as part of it; how many
#: cycles settle.
_UNSETTLED, _SETTLED = 0.01, 8
#: Part by which samples far apart miss a step, in squares of their distance in periods: a slip lies
#: anywhere between two of them.
_COARSE = 1.2
#: Part of the ringing since the begin of a run that settled cycles may still show, and part of a
#: step by which it may differ then.
_LASTS, _RINGING_ON = 0.003, 0.002
#: Precision of positions, m: of the solver of simulated ones, far below any sensor.
PRECISION = 2e-12


@dataclass(frozen=True)
class _Rows:
    """Block means and the columns of the regression that every model has."""

    t: Array  #: middle of each block, s
    width: Array  #: s
    x: Array  #: m
    group: NDArray[np.int64]  #: number of the level that blocks share
    columns: Array  #: cycle numbers of each run; then jumps and ringing
    in_run: NDArray[np.bool_]  #: whether a block is part of a run
    #: Of runs whose ringing since their begin has not died away: its first column, and the part of
    #: it that is there at the last slip.
    unsettled: dict[int, tuple[int, float]]

    def within_groups(self, values: Array) -> Array:
        """Return values without the mean of their group."""
        count = np.maximum(np.bincount(self.group), 1)
        return np.asarray(values - (np.bincount(self.group, values) / count)[self.group])


@dataclass(frozen=True)
class _Model:
    """A fit with some of the disturbances."""

    value: Array  # of each column; nan of those it does not have
    variance: Array  # of each, for a variance of 1
    left: float  # sum of squares, with what the priors add
    unknowns: int
    persistence: float
    volume: float  # logarithm of what is known of smooth columns over their prior
    mains: float | None = None
    information: float = 0.0  # the smaller, the likelier


def fit_steps(
    record: Record,
    mean: MeanPosition,
    grids: Sequence[SlipGrid],
    ringing: Ringing | None,
    rests: Sequence[tuple[Rest | None, Rest | None]],
) -> tuple[list[MeasuredValue], list[Change | None], Disturbances]:
    """Return the steps (m, with their signs) of runs, their changes, and what disturbs the record.

    Raises nothing: a step that rows do not tell is nan.
    """
    unknown: list[MeasuredValue] = [MeasuredValue()] * len(grids)
    unchanged: list[Change | None] = [None] * len(grids)
    rows = _rows_of(record, mean, grids, ringing, rests)
    resting = sum(one is not None for pair in rests for one in pair)
    fit = None if rows is None else _Regression(record, rows, grids, resting > 0)
    if fit is None or not fit.models:
        return unknown, unchanged, Disturbances()
    longest = max((b - a for pair in rests for a, b in filter(None, pair)), default=math.inf)
    steps = []
    for j, grid in enumerate(grids):
        value, spread = fit.mean_of(j)
        unsettled = _UNSETTLED * value if _SHOW_STEP <= grid.count < _SETTLED else 0.0
        before, after = rests[j]
        if grid.count == _SHOW_STEP and before and after:  # the way from rest to rest is another
            way = way_between(mean, before, after, grid.period)
            unsettled = max(unsettled, 0.5 * abs(way / grid.count - value))
        if j in fit.unsettled:
            column, left = fit.unsettled[j]
            waves = [fit.mean_of(column + k)[0] for k in (0, 1)]
            unsettled = math.hypot(unsettled, left * math.hypot(*waves), _RINGING_ON * value)
        coarse = _COARSE * value * (record.spacing / grid.period) ** 2
        # A rest may lie within one step of the converter, which hides a drift.
        hidden = 0.5 * record.resolution * grid.period / longest if resting else 0.0
        error = math.sqrt(spread + unsettled**2 + coarse**2 + hidden**2)
        steps.append(MeasuredValue(value, error))
    changes = [fit.change_of(j, grid) for j, grid in enumerate(grids)]
    return steps, changes, fit.disturbances(record.duration)


def _rows_of(
    record: Record,
    mean: MeanPosition,
    grids: Sequence[SlipGrid],
    ringing: Ringing | None,
    rests: Sequence[tuple[Rest | None, Rest | None]],
) -> _Rows | None:
    """Return the rows of all runs and rests; None where no cycle and no rest shows a step."""
    blocks: list[tuple[Array, float, Array, int]] = []  # begins, width, cycle numbers, level
    # First and last blocks in which it rings, since when, and the run that has not settled, if any.
    rings: list[tuple[int, int, float, int | None]] = []
    level, each = 0, np.eye(len(grids))
    for j, grid in enumerate(grids):
        if grid.count < _SHOW_STEP:
            continue
        cycles = np.arange(max(grid.settling - 1, 0), grid.count - 1, dtype=np.float64)
        parts = int(np.clip(grid.period / record.spacing / _SAMPLES, 1, _PARTS))
        cycles = cycles[:: max(1, len(cycles) * parts // _RUN_ROWS)]
        width = grid.period / parts
        for part in range(parts):
            begins = grid.first + cycles * grid.period + part * width
            blocks.append((begins, width, cycles[:, None] * each[j], level := level + 1))
        if ringing is not None and math.exp(-ringing.decay * grid.period * grid.settling) > _LASTS:
            rings.append((len(blocks) - parts, len(blocks), grid.first - grid.period, j))
    runs, went, seen = level, np.zeros(len(grids)), set()
    swing = math.inf if ringing is None else 0.3 * ringing.swing
    for j, (grid, pair) in enumerate(zip(grids, rests, strict=True)):
        for after, rest in enumerate(pair):
            if after and grid.count < _SHOW_STEP:
                went = went + grid.count * each[j]
            elif after or j == 0:
                level += 1
            width = max(min(grid.period / 8.0, swing), 2.0 * record.spacing)
            count = 0 if rest is None else min(int((rest[1] - rest[0]) / width), _REST_ROWS)
            if rest is None or rest in seen or count < 2:
                continue
            seen.add(rest)
            if after and count > 8 and ringing is not None:
                rings.append((len(blocks), len(blocks) + 1, rest[0], None))
            width = (rest[1] - rest[0]) / count
            begins = rest[0] + width * np.arange(count, dtype=np.float64)
            blocks.append((begins, width, np.tile(went, (count, 1)), level))
    if not blocks:
        return None
    sizes = [len(one[0]) for one in blocks]
    block = np.repeat(np.arange(len(blocks)), sizes)
    begin = np.concatenate([one[0] for one in blocks])
    long = np.repeat([one[1] for one in blocks], sizes)
    group = np.repeat([one[3] for one in blocks], sizes)
    columns = [np.concatenate([one[2] for one in blocks])]
    if record.jumps:
        columns.append(np.sum([
            one.fringes * np.clip((begin + long - one.t) / long, 0.0, 1.0)
            for one in record.jumps
        ], axis=0)[:, None])  # fmt: skip
    unsettled = {}
    for first, last, start, run in rings:
        assert ringing is not None
        if run is not None:
            fades = math.exp(-ringing.decay * (grids[run].last - start))
            unsettled[run] = sum(one.shape[1] for one in columns), fades
        inside = (block >= first) & (block < last)
        power = 2j * math.pi * ringing.frequency - ringing.decay
        wave = np.exp(np.where(inside, power * (begin - start), 0.0))
        wave = np.where(inside, wave * np.expm1(power * long) / (power * long), 0.0)
        columns.append(np.stack([wave.real, wave.imag], axis=1))
    # A pause is no sample.
    full = np.searchsorted(record.t, begin + long) > np.searchsorted(record.t, begin)
    return _Rows(
        (begin + 0.5 * long)[full], long[full], mean.between(begin, begin + long)[full],
        np.unique(group[full], return_inverse=True)[1], np.hstack(columns)[full],
        (group <= runs)[full], unsettled,
    )  # fmt: skip


def _weights(rows: _Rows, design: Array, x: Array, least: float) -> Array:
    """Return the weights of rows: one over what differs between neighbours, in runs and in rests.

    design and x are columns and positions (m) within groups; least (m) is what differs at least.
    """
    left = x - design @ np.linalg.lstsq(design, x, rcond=None)[0]
    scatter = np.full(len(x), math.nan)
    for part in (rows.in_run, ~rows.in_run):
        if part.sum() > 3:
            scatter[part] = max(float(np.std(np.diff(left[part]))) / math.sqrt(2.0), least)
    scatter[np.isnan(scatter)] = np.nanmax(scatter, initial=least)
    return np.asarray(scatter.min() / scatter)


class _Regression:
    """The fits of all models of drift and hum to the rows, by one decomposition of all columns."""

    def __init__(self, record: Record, rows: _Rows, grids: Sequence[SlipGrid], rests: bool) -> None:
        self._rows, self._runs, self.unsettled = rows, len(grids), rows.unsettled
        since = (rows.t - record.t[0]) / record.duration
        blocks = {"": list(rows.columns.T)}
        if rests:
            blocks["drift"] = [since]
            bends = np.polynomial.legendre.legvander(2.0 * since - 1.0, _BENDS).T
            blocks["bend"] = list(bends[2:])
            blocks["walk"] = [np.sin(math.pi * (k + 0.5) * since) for k in range(_WAVES)]
        for mains in MAINS:
            if record.duration * mains > SETTINGS.periods_of_hum:
                blocks[f"{mains:g}"] = hum_columns(rows.t, (mains,), width=rows.width)
        self._knees = self._knees_of(grids)
        blocks |= {f"knee {j} {k}": [one] for (j, k), one in self._knees.items()}
        self._places: dict[str, NDArray[np.int64]] = {}
        columns: list[Array] = []
        for name, of_block in blocks.items():
            self._places[name] = np.arange(len(columns), len(columns) + len(of_block))
            columns += [rows.within_groups(one) for one in of_block]
        design, x = np.column_stack(columns), rows.within_groups(rows.x)
        precision = PRECISION + 0.1 * record.resolution
        weight = _weights(rows, design[:, self._places[""]], x, precision)
        self._decompose(design * weight[:, None], x * weight)
        self._free = len(rows.x) - int(np.count_nonzero(np.bincount(rows.group)))
        self.models: list[_Model] = []
        self.chance = precision**2
        plain = self._solve({})
        if plain is None or not self._used[: self._runs].any():
            return
        self._step = float(np.nanmax(np.abs(plain.value[: self._runs]), initial=1e-12))
        usual = max(_DRIFT * record.duration, _DRIFT_STEPS * self._step)
        slow: list[tuple[dict[str, Array], float]] = [({}, 1.0)]
        if rests:
            drift = {"drift": np.array([usual])}
            slow = [(drift, 1.0)]
            for times in _BENT:
                bend = np.full(_BENDS - 1, 0.5 * times * usual)
                slow.append(({**drift, "bend": bend}, _BENT_ODDS / len(_BENT)))
            for far in _WALKS:
                walk = np.asarray(far * math.sqrt(2.0) / (math.pi * (np.arange(_WAVES) + 0.5)))
                slow.append(({**drift, "walk": walk}, _WALK_ODDS / len(_WALKS)))
        fast: list[tuple[dict[str, Any], float | None]] = [({}, None)]
        for mains in MAINS:
            if f"{mains:g}" in blocks:
                sizes = np.asarray(_USUAL / np.repeat(np.arange(1.0, HARMONICS + 1.0), 2))
                fast.append(({f"{mains:g}": sizes}, mains))
        # The variance of independent rows is that of the fit that leaves least, without priors.
        chances = []
        for names in ([*one[0], *other[0]] for one in (slow[0], slow[-1]) for other in fast):
            found = self._solve(
                {name: np.full(len(self._places[name]), math.inf) for name in names}
            )
            if found is not None and self._free - found.unknowns >= max(0.5 * self._free, 1.0):
                chances.append(found.left / (self._free - found.unknowns) * found.persistence)
        chances = chances or [plain.left / max(self._free - plain.unknowns, 1) * plain.persistence]
        self.chance = max(min(chances), self.chance)
        self._cases = [
            ({**one, **other}, odds * (_HUM_ODDS if mains else 1.0), mains)
            for one, odds in slow
            for other, mains in fast
        ]
        for case in self._cases:
            model = self._model(*case)
            if model is not None:
                self.models.append(model)
        information = np.array([one.information for one in self.models])
        share = np.exp(-0.5 * np.minimum(information - information.min(), 600.0))
        self._share = share / share.sum()

    def mean_of(self, column: int) -> tuple[float, float]:
        """Return the mean of a column (m) over the models, and its variance (m^2)."""
        value = float(
            sum(p * m.value[column] for p, m in zip(self._share, self.models, strict=True))
        )
        spread = 0.0
        for p, model in zip(self._share, self.models, strict=True):
            freedom = max(self._free / model.persistence - model.unknowns, 1.0)
            own = model.left / max(self._free - model.unknowns, 1) * model.persistence
            variance = max(self.chance, own) * float(model.variance[column])
            spread += p * (variance * (1.0 + 2.0 / freedom) + (model.value[column] - value) ** 2)
        return value, spread

    def change_of(self, run: int, grid: SlipGrid) -> Change | None:
        """Return where the steps of a run change, if that is likelier than any drift."""
        least = min(one.information for one in self.models) - SETTINGS.information_of_change
        change = None
        for j, cycle in self._knees:
            if j != run:
                continue
            name = f"knee {j} {cycle}"
            size = np.array([_CHANGES * self._step])
            for sizes, odds, mains in self._cases[: 1 + len(MAINS)]:
                model = self._model({**sizes, name: size}, odds * _CHANGE_ODDS / _PLACES, mains)
                if model is not None and model.information < least:
                    least = model.information
                    before = float(model.value[run])
                    after = before + float(model.value[self._places[name][0]])
                    change = Change(grid.first + cycle * grid.period, before, after)
        if change is None or abs(change.after / change.before - 1.0) < SETTINGS.least_change:
            return None
        return change

    def disturbances(self, duration: float) -> Disturbances:
        """Return drift and hum of the likeliest model; duration (s) is that of the record."""
        best = self.models[int(np.argmax(self._share))]
        variance = max(self.chance, best.left / max(self._free - best.unknowns, 1))
        error = np.sqrt(variance * best.variance)
        drift, drift_error = 0.0, math.inf
        if "drift" in self._places:
            k = int(self._places["drift"][0])
            drift, drift_error = float(best.value[k]) / duration, float(error[k]) / duration
        if best.mains is None:
            return Disturbances(drift, drift_error, duration=duration)
        at = self._places[f"{best.mains:g}"]
        waves = tuple((float(a), float(b)) for a, b in best.value[at].reshape(-1, 2))
        return Disturbances(drift, drift_error, best.mains, waves, float(error[at].max()), duration)

    def _knees_of(self, grids: Sequence[SlipGrid]) -> dict[tuple[int, int], Array]:
        """Return the cycle numbers beyond a cycle of a run, by run and cycle."""
        found = {}
        for j, grid in enumerate(grids):
            if grid.count >= _MANY:
                places = np.linspace(grid.settling, grid.count - 1, _PLACES + 2)[1:-1]
                own = self._rows.columns[:, j]
                for cycle in np.unique(np.rint(places)).astype(int).tolist():
                    found[j, cycle] = np.maximum(own - cycle, 0.0)
        return found

    def _decompose(self, columns: Array, y: Array) -> None:
        scale = np.sqrt(np.sum(columns * columns, axis=0))
        self._used = scale > 1e-12 * max(float(scale.max()), 1e-30)  # a jump beside all rows is 0
        self._scale = np.where(self._used, scale, 1.0)
        self._columns, self._y = columns / self._scale, y
        count = columns.shape[1]
        both = np.asarray(np.linalg.qr(np.column_stack([self._columns, y]), mode="r"))
        self._r, self._seen = both[:count, :count], both[:count, count]
        self._unseen = float(np.sum(both[count:, count] ** 2))
        self._order = np.argsort(self._rows.t, kind="stable")
        self._ordered_run = self._rows.in_run[self._order]

    def _model(self, sizes: dict[str, Array], odds: float, mains: float | None) -> _Model | None:
        """Return the fit with blocks of columns of prior sizes (m), as probable as their odds."""
        found = self._solve(sizes)
        if found is None:
            return None
        information = found.left / self.chance + found.volume - 2.0 * math.log(odds)
        return replace(found, mains=mains, information=information)

    def _solve(self, sizes: dict[str, Array]) -> _Model | None:
        """Return the fit with blocks of prior sizes (m); None where rows do not tell them apart."""
        prior = np.full(len(self._scale), math.inf)
        for name, size in sizes.items():
            prior[self._places[name]] = size
        index = np.concatenate([self._places[name] for name in ("", *sizes)])
        index = index[self._used[index]]
        size = prior[index] * self._scale[index] / math.sqrt(self.chance)
        tight, smooth = np.diag(1.0 / size), np.isfinite(size)
        if not len(index) or len(self._y) <= np.count_nonzero(~smooth):
            return None
        r = self._r[:, index]
        q, own = np.linalg.qr(np.vstack([r, tight]))
        if np.abs(np.diag(own)).min() < _INDEPENDENT:
            return None
        inverse = np.linalg.inv(own)
        found = inverse @ (q.T @ np.concatenate([self._seen, np.zeros(len(index))]))
        rest = self._seen - r @ found
        left = (self._y - self._columns[:, index] @ found)[self._order]
        penalty = float(np.sum((tight @ found) ** 2))
        waves = r[:, smooth] * size[smooth]
        _, volume = np.linalg.slogdet(np.eye(waves.shape[1]) + waves.T @ waves)
        value, variance = np.full((2, len(self._scale)), math.nan)
        value[index] = found / self._scale[index]
        variance[index] = np.sum(inverse**2, axis=1) / self._scale[index] ** 2
        return _Model(
            value, variance, self._unseen + float(rest @ rest) + penalty,
            int(np.count_nonzero(~smooth)),
            max(persistence(left), persistence(left[self._ordered_run])), float(volume),
        )  # fmt: skip


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
