# SPDX-License-Identifier: Apache-2.0
"""Steps, drift and hum by one least squares fit of all runs and rests of a measurement.

Given the start and period of each run, a position is

    place of the rest or run + drift t + hum + step times number of the cycle + shape of the cycle

in which the shape is the same in all settled cycles of a run. Positions at one phase of all cycles
contain the same shape, so subtracting their mean removes it, and the rest is linear. A short
measurement hardly determines drift and hum. So both have normal priors with a mean of zero (ridge
regression), as wide as usual on a bench, and the standard errors include what remains unknown.
Outliers are left out by their median deviation. Residuals of neighbouring samples are correlated,
so a standard error counts only the independent ones. The result is averaged over the cases with and
without hum of each mains, and with a straight drift, a bent one, or a random walk of each of some
sizes, weighted by probability (J. Hoeting et al., Statistical Science 14 (1999) 382).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy  # its parts load when they are used, which takes half a second
from numpy.typing import NDArray

from stickslip_ros.arrays import Array
from stickslip_ros.motion.settled import SETTLING, settled_from
from stickslip_ros.traces.even_samples import (
    PHASES,
    EvenSamples,
    SlipGrid,
    correlation_time,
    cycles_on_grid,
    phases_of,
    robust_std,
    sample_cycles,
)
from stickslip_ros.traces.hum import MAINS, USUAL, hum_columns
from stickslip_ros.traces.measured_value import MeasuredValue
from stickslip_ros.traces.ringing import Ringing


@dataclass(frozen=True)
class JointFitSettings:
    """Widths of the priors, limits of outliers, and what counts as a clear disturbance."""

    drift: float = 3e-7  #: standard deviation of the drift beforehand, m/s, as on a bench
    step: float = 1e-5  #: the same of a step, m: wider than any
    start: float = 2e-8  #: the same of what is left of the start in settled cycles, m
    hum_odds: float = 0.01  #: how probable hum of either mains is beforehand
    bent_odds: float = 0.01  #: the same of a drift that is not straight
    bends: int = 5  #: highest order of such a drift: what is slower than a run, and a bit beyond
    bent: tuple[float, ...] = (1.0, 10.0)  #: times the usual drift by which one that bends is tried
    walk_odds: float = 0.2  #: the same of noise that adds up to a random walk, as pink noise does
    #: How far (m) such a walk gets over the record, by which all its sizes are tried.
    walks: tuple[float, ...] = (3e-10, 1e-9, 3e-9, 1e-8, 3e-8, 1e-7)
    waves: int = 24  #: of the series of a walk: what is faster is noise
    harmonics: int = 5  #: of the mains
    far: float = 5.0  #: standard deviations beyond which samples are left out
    rounds: int = 3  #: of leaving out
    rest_rows: int = 400  #: of a rest, at most: it has but place and drift
    rest_samples: int = 12  #: of a rest, at least
    phases: int = 4  #: of a cycle, at least
    cells: int = 20_000  #: of a run, about: time for no gain in runs of hundreds of cycles
    cycles: int = 320  #: of a run, at most
    whole: float = 0.5  #: part of a cycle that is known, at least
    still: float = 0.05  #: part of a step by which the runner moves in a rest, at most
    decays: float = 1.0  #: of the ringing in a cycle where none is seen
    rung: float = 0.05  #: periods after a slip from which on there is rest
    late: float = -0.5  #: phase from which on cycles count in runs too short to settle
    plain: float = 5.0  #: standard errors from which on drift and hum are plainly there
    adds_up: float = 2e-9  #: m that the drift comes to at least where it is reported
    swings: float = 5e-10  #: m that the hum swings at least where it is reported


SETTINGS = JointFitSettings()
#: Kinds of columns beside the hum of mains (Hz): of one run, the drift, its bends, a random walk.
_OWN, _DRIFT, _BENDS, _WALK = 0.0, -1.0, -2.0, -3.0
#: Scales of drift, bends and walk, and how probable they are beforehand.
_SLOW = (
    ((1.0, 0.0, 0.0), 1.0 - SETTINGS.bent_odds - SETTINGS.walk_odds),
    *(((one, one, 0.0), SETTINGS.bent_odds / len(SETTINGS.bent)) for one in SETTINGS.bent),
    *(((1.0, 0.0, far), SETTINGS.walk_odds / len(SETTINGS.walks)) for far in SETTINGS.walks),
)
#: The same for hum of which mains (Hz).
_HUM = ((None, 1.0 - len(MAINS) * SETTINGS.hum_odds), *((one, SETTINGS.hum_odds) for one in MAINS))
#: What is compared: hum and scales.
CASES = tuple((mains, scales) for scales, _ in _SLOW for mains, _ in _HUM)


@dataclass(frozen=True)
class Disturbances:
    """Drift and hum of a measured position."""

    drift: float = 0.0  #: m/s
    drift_error: float = math.inf  #: standard error, m/s
    duration: float = 0.0  #: of the measurement, s
    mains: float | None = None  #: Hz; None: no hum is fitted
    waves: tuple[tuple[float, float], ...] = ()  #: cosine and sine (m) of each harmonic
    hum_error: float = math.inf  #: standard error of the amplitude, m
    bends: tuple[
        float, ...
    ] = ()  #: Legendre polynomials over the record, m; none if it is straight

    @property
    def hum(self) -> float:
        """Amplitude of the strongest harmonic, m."""
        return max((math.hypot(*wave) for wave in self.waves), default=0.0)

    @property
    def drifts(self) -> bool:
        """Whether the drift is plainly there."""
        clear = abs(self.drift) > SETTINGS.plain * self.drift_error
        return clear and abs(self.drift) * self.duration > SETTINGS.adds_up

    @property
    def hums(self) -> bool:
        """Whether the hum is plainly there."""
        return self.hum > max(SETTINGS.plain * self.hum_error, SETTINGS.swings)

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

    def at(self, t: Array, drift: bool = True, hum: bool = True) -> Array:
        """Return drift and hum (m) at times (s); the drift counts from the first of them.

        A bent drift is that of the whole record, which times begin with.
        """
        total = self.drift * (t - t[0]) if drift else np.zeros_like(t)
        if drift and self.bends:
            place = 2.0 * (t - t[0]) / self.duration - 1.0
            total = total + np.polynomial.legendre.legval(place, [0.0, 0.0, *self.bends])
        if hum and self.mains is not None:
            columns = hum_columns(t, (self.mains,), len(self.waves))
            total = total + np.stack(columns, axis=-1) @ np.ravel(self.waves)
        return total


def without_disturbances(even: EvenSamples, found: Disturbances) -> EvenSamples:
    """Return a measurement without the drift and the hum that are plainly there."""
    if not (found.drifts or found.hums or found.bends):
        return even
    t: Array = even.begin + even.tick * np.arange(len(even.x), dtype=np.float64)
    return replace(
        even, x=np.asarray(even.x - found.at(t, found.drifts or bool(found.bends), found.hums))
    )


@dataclass(frozen=True)
class FitRows:
    """Rows of a run or rest, without the unknowns of no interest that they share."""

    t: Array  #: s, (rows,)
    weight: float  #: of each row: root of the number of samples that it is the mean of
    without: Callable[[Array], Array]  #: takes those unknowns out of columns, (rows, n)
    x: Array  #: position, m, (rows, 1)
    own: Array  #: columns of this run alone, (rows, n), the step first; none of a rest
    widths: Array  #: standard deviations beforehand of these unknowns, (n,)
    settled: int = 1  #: cycles that the step is the mean of
    unsettled: float = 0.0  #: by how much (m) the step may be off as the cycles have not settled


def fit_steps(
    even: EvenSamples, grids: list[SlipGrid], ringings: list[Ringing | None]
) -> tuple[list[MeasuredValue], Disturbances]:
    """Fit the step of each run, and drift and hum of the whole measurement.

    Steps (m) are positive in the direction of the run; ringings are those of the runs. The step is
    nan for a run without samples in settled cycles.
    """
    runs = [_run_block(even, one, ring) for one, ring in zip(grids, ringings, strict=True)]
    rests = cut_rests(even, grids, ringings)
    blocks = [one for one in runs if one is not None] + rests
    if not blocks:
        return [MeasuredValue(math.nan, math.nan) for _ in grids], Disturbances()
    y = np.concatenate([one.weight * one.x[:, 0] for one in blocks])
    own = scipy.linalg.block_diag(*[one.weight * one.own for one in blocks])
    common = [one.weight * one.without(_common(one.t, even)) for one in blocks]
    disturbed, kind = _common_widths(even.end - even.begin)
    widths = np.concatenate((*(one.widths for one in blocks), disturbed))
    kinds = np.concatenate((np.full(own.shape[1], _OWN), kind))
    plain = np.isin(kinds, [_OWN, _DRIFT])
    rows = Rows(np.hstack((own, np.concatenate(common))) * widths, y, plain)
    fits = []
    for mains, (drift, bends, walk) in CASES:
        scale = {_OWN: 1.0, _DRIFT: drift, _BENDS: bends, _WALK: walk, mains: 1.0}
        fits.append(RidgeFit(rows, widths, np.array([scale.get(one, 0.0) for one in kinds])))
    chance = min(fit.chance for fit in fits)
    odds = np.log([slow * hum for _, slow in _SLOW for _, hum in _HUM])
    likely = scipy.special.log_softmax(odds + [fit.evidence(chance) for fit in fits])
    steps, found = average_fits(runs, fits, likely, chance, own.shape[1])
    return steps, replace(found, duration=even.end - even.begin)


def average_fits(
    runs: list[FitRows | None], fits: list[RidgeFit], likely: Array, chance: float, own: int
) -> tuple[list[MeasuredValue], Disturbances]:
    """Return steps and disturbances, averaged over the fits of `CASES`.

    likely is the logarithm of how probable each is.
    """
    share = np.exp(likely)

    def mean(column: int) -> tuple[float, float]:
        found = [fit.value(column, chance) for fit in fits]
        value = float(sum(p * x for p, (x, _) in zip(share, found, strict=True)))
        spread = sum(
            p * (error**2 + (x - value) ** 2) for p, (x, error) in zip(share, found, strict=True)
        )
        return value, math.sqrt(spread)

    steps, column = [], 0
    for block in runs:
        if block is None:
            steps.append(MeasuredValue(math.nan, math.nan))
            continue
        size, error = mean(column)
        left = [mean(column + k)[0] for k in range(2, block.own.shape[1])]
        swing = block.unsettled + 0.5 * math.hypot(*left) / block.settled
        steps.append(MeasuredValue(size, math.hypot(error, swing)))
        column += block.own.shape[1]
    drift, drift_error = mean(own)
    best = int(np.argmax(share))
    mains, (_, bent, _) = CASES[best]
    found, next_ = Disturbances(drift, drift_error), own + 1

    def of_best(count: int) -> list[tuple[float, float]]:
        return [fits[best].value(next_ + k, chance) for k in range(count)]

    if mains is not None:
        hum = of_best(2 * SETTINGS.harmonics)
        waves = tuple((hum[k][0], hum[k + 1][0]) for k in range(0, len(hum), 2))
        error = max(error for _, error in hum[:2])
        found, next_ = replace(found, mains=mains, waves=waves, hum_error=error), next_ + len(hum)
    bends = of_best(SETTINGS.bends - 1) if bent else []
    return steps, replace(found, bends=tuple(size for size, _ in bends))


class Rows:
    """Rows of a least squares problem, outliers left out, and their QR decomposition.

    The same rows are left out in all cases that are compared: those far from the plainest of them.
    """

    def __init__(self, columns: Array, y: Array, plain: NDArray[np.bool_]) -> None:
        used = np.ones(len(y), dtype=bool)
        plainest = columns[:, plain]
        for _ in range(SETTINGS.rounds):
            kept = plainest if used.all() else plainest[used]
            # For outliers, squares are exact enough, and far quicker.
            found, *_ = np.linalg.lstsq(kept.T @ kept, kept.T @ y[used], rcond=1e-12)
            left = y - plainest @ found
            usual = robust_std(left[used]) + 1e-30
            before, used = used, np.abs(left) <= SETTINGS.far * usual
            if np.count_nonzero(used) <= plainest.shape[1]:
                used = before  # of a record that stands still, what is usual is rounding
                break
            if (used == before).all():
                break
        self.columns, self.y = (columns, y) if used.all() else (columns[used], y[used])
        both = np.column_stack((self.columns, self.y))
        #: Of all columns and y.
        self.triangle: Array = np.asarray(np.linalg.qr(both, mode="r"))


class RidgeFit:
    """Ridge regression with columns in units of their standard deviations beforehand."""

    def __init__(self, rows: Rows, widths: Array, scales: Array) -> None:
        """Fit columns of rows times scales, those of 0 not at all; widths are those of all."""
        of = scales > 0.0
        self._widths = (widths * scales)[of]
        # By singular values: squared first, columns that are nearly alike leave only rounding.
        across, sizes, along = np.linalg.svd(rows.triangle[:, :-1][:, of] * scales[of])
        sizes = np.append(sizes, np.zeros(len(along) - len(sizes)))
        self._axes, self.squares = along.T, sizes**2
        self._seen = across.T @ rows.triangle[:, -1]
        self._product = sizes * np.resize(self._seen, len(sizes))
        told = sizes > 1e-6 * sizes[0]
        found = np.zeros(len(of))
        found[of] = self._axes[:, told] @ (self._product[told] / self.squares[told])
        found[of] *= scales[of]
        left = rows.y - rows.columns @ found
        free = max(len(left) - len(sizes), 1)
        #: Variance (m^2) that a row has in effect, what it shares with its neighbours included.
        self.chance = float(left @ left) / free * correlation_time(left) + 1e-30

    def evidence(self, chance: float) -> float:
        """Return the logarithm of the probability of the rows, but for a constant."""
        certain = self.squares / chance + 1.0
        left = self._seen**2
        left[: len(certain)] /= certain[: len(left)]
        return -0.5 * float(np.sum(left) / chance + np.sum(np.log(certain)))

    def value(self, column: int, chance: float) -> tuple[float, float]:
        """Return the value of an unknown and its standard error, both SI."""
        share = self._axes[column]
        certain = self.squares / chance + 1.0
        value = float(np.sum(share * self._product / certain)) / chance
        width = float(self._widths[column])
        return width * value, width * math.sqrt(float(np.sum(share**2 / certain)))


def _run_block(even: EvenSamples, grid: SlipGrid, ringing: Ringing | None) -> FitRows | None:
    number = sample_cycles(grid.count, SETTINGS.cycles)
    phases = phases_of(even, grid.period, min(PHASES, SETTINGS.cells // len(number)))
    phases = phases[phases < 0.0]
    short = settled_from(grid.count) < SETTLING
    if short:
        phases = phases[phases > SETTINGS.late]
    number = number[number >= max(settled_from(grid.count) - 1, 0)]
    slips = grid.first + grid.period * number
    cells = cycles_on_grid(even, np.asarray(slips, np.float64), grid.period, phases)
    whole = np.isfinite(cells).mean(axis=1) > SETTINGS.whole
    cells, number, slips = cells[whole], number[whole], slips[whole]
    if len(cells) < 2 or len(phases) < SETTINGS.phases:
        return None
    known = np.isfinite(cells)
    count = np.maximum(known.sum(axis=0), 1)[:, None]

    def without(columns: Array) -> Array:
        by_phase = np.where(known[:, :, None], columns.reshape(*known.shape, -1), 0.0)
        by_phase = by_phase - by_phase.sum(axis=0) / count
        return np.where(known[:, :, None], by_phase, 0.0).reshape(columns.shape)

    shape = np.where(known, cells - np.nanmean(cells, axis=1, keepdims=True), 0.0).sum(axis=0)
    speed = np.gradient(shape / count[:, 0], phases * grid.period)
    t = slips[:, None] + grid.period * phases
    rows = np.repeat(number.astype(np.float64), len(phases))
    own = [grid.direction * rows, rows * np.tile(speed, len(cells))]
    widths = [SETTINGS.step, even.tick]
    if ringing is not None:  # what is left of the start rings on and decays
        own += list(ringing.columns((t - t[0, 0]).ravel()).T)
        widths += [SETTINGS.start, SETTINGS.start]
    weight = math.sqrt(max((phases[1] - phases[0]) * grid.period / even.tick, 1.0))
    x = np.where(known, cells, 0.0).reshape(-1, 1)
    columns = without(np.stack(own, axis=1))
    first, off = settled_from(grid.count), 0.0
    if short:  # the ringing of a cycle lasts into the next ones and shifts where their slips begin
        about = cells - np.nanmean(cells, axis=1, keepdims=True)
        decays = SETTINGS.decays if ringing is None else max(ringing.decay, 0.0) * grid.period
        swing = 0.5 * float(np.nanmax(about) - np.nanmin(about))
        off = swing * math.exp(-decays * first) / (grid.count - first)
    settled = grid.count - first
    return FitRows(t.ravel(), weight, without, without(x), columns, np.array(widths), settled, off)


def cut_rests(
    even: EvenSamples, grids: list[SlipGrid], ringings: list[Ringing | None]
) -> list[FitRows]:
    """Return the rests before, between and after the runs; after a run, the runner rings on."""
    ends = [one.begin for one in grids] + [even.end]
    begins = [even.begin] + [
        _rest_begin(even, one, end) for one, end in zip(grids, ends[1:], strict=True)
    ]
    blocks = []
    for begin, end, ringing in zip(begins, ends, [None, *ringings], strict=True):
        if end - begin < SETTINGS.rest_samples * even.tick:
            continue
        count = int(min((end - begin) / even.tick, SETTINGS.rest_rows))
        edges = np.linspace(begin, end, count + 1)
        x = even.means(edges)
        good = np.isfinite(x)
        if good.sum() < SETTINGS.rest_samples:
            continue
        t = (0.5 * (edges[1:] + edges[:-1]))[good]
        shared = [np.ones((len(t), 1))]
        if ringing is not None:
            shared.append(ringing.columns(t - begin))
        blocks.append(_rest_block(t, x[good], (end - begin) / count / even.tick, shared))
    return blocks


def _rest_begin(even: EvenSamples, grid: SlipGrid, end: float) -> float:
    """Return when (s) the rest after a run begins: a last rise without a slip is not rest.

    That is the end where the record stops within the rise.
    """
    begin = grid.end + SETTINGS.rung * grid.period
    later = begin + grid.period
    if later + grid.period > end:
        later = end
    places = even.means(np.linspace(begin, later, 9))
    rest = places[-1:] if later == end else even.means(np.array([later, later + grid.period]))
    return later if np.fmax.reduce(np.abs(places - rest)) > SETTINGS.still * grid.step else begin


def _rest_block(t: Array, x: Array, samples: float, shared: list[Array]) -> FitRows:
    basis, _ = np.linalg.qr(np.hstack(shared))

    def without(columns: Array) -> Array:
        return np.asarray(columns - basis @ (basis.T @ columns))

    weight = math.sqrt(max(samples, 1.0))
    return FitRows(t, weight, without, without(x[:, None]), np.zeros((len(t), 0)), np.zeros(0))


def _common(t: Array, even: EvenSamples) -> Array:
    """Return columns of drift, hum of either mains, a bent drift and a random walk at times (s)."""
    columns = [t, *(wave for one in MAINS for wave in hum_columns(t, (one,), SETTINGS.harmonics))]
    place = (t - even.begin) / (even.end - even.begin)
    columns += list(np.polynomial.legendre.legvander(2.0 * place - 1.0, SETTINGS.bends).T[2:])
    # The series of Karhunen and Loeve.
    columns += [np.sin(math.pi * (k + 0.5) * place) for k in range(SETTINGS.waves)]
    return np.stack(columns, axis=1)


def _common_widths(duration: float) -> tuple[Array, Array]:
    """Return the standard deviations beforehand of these columns, and the kind of each.

    Those of a walk that gets 1 m far.
    """
    hum = USUAL / np.repeat(np.arange(1.0, SETTINGS.harmonics + 1.0), 2)
    bends = np.full(SETTINGS.bends - 1, 0.5 * duration * SETTINGS.drift)
    walk = math.sqrt(2.0) / (math.pi * (np.arange(SETTINGS.waves) + 0.5))
    parts = [(_DRIFT, np.array([SETTINGS.drift])), *((one, hum) for one in MAINS)]
    parts += [(_BENDS, bends), (_WALK, walk)]
    kinds = np.repeat([kind for kind, _ in parts], [len(widths) for _, widths in parts])
    return np.concatenate([widths for _, widths in parts]), kinds
