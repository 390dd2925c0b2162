# SPDX-License-Identifier: Apache-2.0
"""One trace in blocks of samples: residuals in units of its noise, without errors of the sensor.

A block is the mean of neighbouring samples. The model is computed at its middle, and corrected by
its second difference for the spread of the sample times, and for the width of the time over which
the instrument averages. The residuals go through the Fourier transform and are divided by the root
of S(f) = a + b/f + c/f^2. These three numbers make the likelihood of the bins beside the harmonics
of the drive largest (P. Whittle, Ark. Mat. 2 (1953) 423), so that a misfit hardly passes for noise.
Drift and waves of both mains are columns with priors, projected out for each set of parameters
(variable projection: G. H. Golub, V. Pereyra, SIAM J. Numer. Anal. 10 (1973) 413); the zero is the
bin at 0 Hz, which is left out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import scipy  # its parts load when they are used, which takes half a second
from numpy.typing import NDArray

from stickslip_ros.base.arrays import Array
from stickslip_ros.measurement.identification.experiment import Experiment, bend_of
from stickslip_ros.measurement.steps.disturbances import HARMONICS, MAINS, hum_columns
from stickslip_ros.measurement.steps.noise import noise_of, without_spikes
from stickslip_ros.physics.model import Plant
from stickslip_ros.physics.parameters import Parameters

#: Unit of the starts (s), of the rate (s/s) and of the squared width (s^2) as unknowns.
CLOCK, RATE, WIDTH = 1e-6, 1e-5, 1e-12
#: Standard deviation of the rate of a recorder's clock, s/s.
_RATE_DEVIATION = 3e-4
#: Blocks of a trace at most, and in a swing of the ringing at least.
_BLOCKS, _A_SWING = 6000, 10.0
#: Spacings without a sample that make a gap; empty blocks of one at most, which only have to
#: separate its sides.
_GAP, _EMPTY = 2.5, 3000
#: Standard deviations beforehand: amplitude (m) of the first wave of hum, that of wave n is n times
#: smaller; frequency (Hz) of the mains. A hum that stands out widens the first.
_HUM, _MAINS_OFF = 8e-9, 0.05
#: Least noise of a block, m: that of simulated records is 0.
_LEAST = 1e-13
#: Bins beside a harmonic of the drive that belong to it.
_BESIDE = 2.1
#: Blocks without a part of which the spectrum of the noise is not fitted.
_FEWEST = 16


@dataclass(frozen=True)
class Blocks:
    """Means of neighbouring samples; arrays have shape (blocks,)."""

    t: Array  #: mean time, s
    x: Array  #: mean position, m; of an empty block on the line between its neighbours
    spread: Array  #: variance of the sample times, s^2
    full: NDArray[np.bool_]  #: whether it holds samples; those without fill gaps
    count: int  #: samples of a full one

    @classmethod
    def of(cls, experiment: Experiment) -> Blocks:
        """Put the samples of an experiment into blocks of one number of samples each."""
        motion, p = experiment.motion, experiment.parameters
        t, x, spacing = motion.t, motion.x, motion.spacing
        kept = without_spikes(x, noise_of(x))
        x = np.interp(t, t[kept], x[kept])
        seen = experiment.ringing.frequency if experiment.ringing else 0.0
        swing = 1.0 / max(seen or Plant.of(p).ringing_frequency, p.drive.frequency)
        count = int(min(swing / (_A_SWING * spacing), math.ceil(len(t) / _BLOCKS)))
        count = max(count, 1)
        edges = np.flatnonzero(np.diff(t) > _GAP * spacing) + 1
        times: list[Array] = []
        means, spreads, full = [], [], []
        for part, values in zip(np.split(t, edges), np.split(x, edges), strict=True):
            whole = len(part) // count * count
            if not whole:
                continue
            each, own = part[:whole].reshape(-1, count), values[:whole].reshape(-1, count)
            middle = each.mean(axis=1)
            if times:
                last = float(times[-1][-1])
                missing = round((middle[0] - last) / (count * spacing)) - 1
                missing = min(max(missing, 0), _EMPTY)
                times.append(np.linspace(last, middle[0], missing + 2)[1:-1])
                means.append(np.zeros(missing))
                spreads.append(np.zeros(missing))
                full.append(np.zeros(missing, bool))
            times.append(middle)
            means.append(own.mean(axis=1))
            spreads.append(each.var(axis=1))
            full.append(np.ones(len(middle), bool))
        middles, filled = np.concatenate(times), np.concatenate(full)
        number = len(middles)  # some blocks of the last rest less make all transforms far quicker
        while scipy.fft.next_fast_len(number, real=True) != number:
            number -= 1
        middles, filled = middles[:number], filled[:number]
        every, spreads = np.concatenate(means)[:number], [np.concatenate(spreads)[:number]]
        every = np.interp(middles, middles[filled], every[filled])
        averaged = spacing**2 / 12.0 if experiment.samples == "mean" else 0.0
        return cls(middles, every, np.concatenate(spreads) + averaged, filled, count)


@dataclass(frozen=True)
class Seen:
    """The model as a measurement sees it, without errors of the sensor; arrays (blocks,)."""

    x: Array  #: m
    v: Array  #: m/s
    bend: Array  #: second derivative of x, m/s^2


#: What `Trace._nodes` was made of, and returned.
_Kept = tuple[
    tuple[Experiment, tuple[float, ...]], tuple[NDArray[np.int64], Array, NDArray[np.int64]]
]
#: Blocks before and after a slip that are looked at more finely, and looks in one.
_ABOUT_SLIP, _LOOKS = 1.5, 8


class Trace:
    """One experiment with what is unknown of its sensor.

    ``clock`` holds the starts of the runs (in microseconds from where they were found) and the
    rate of the measurement's clock (in 1e-5), shape (runs + 1,).
    """

    #: Step of differences by logarithms of parameters.
    step = 3e-4
    #: Residual of a clock rate of 1 `RATE`, in standard deviations.
    clock_weight = RATE / _RATE_DEVIATION

    def __init__(self, experiment: Experiment) -> None:
        """Put the samples into blocks; the noise is taken for white."""
        self.experiment = experiment
        self.blocks = Blocks.of(experiment)
        self.starts = np.array([run.start for run in experiment.runs])
        self.clocks = len(self.starts) + 1
        self.placed = False  #: whether models have been laid over the runs
        self.mains: tuple[float, ...] = ()  #: frequencies of hum that stands out, Hz
        self.loudness = 0.0  #: of the noise against what it was taken for, in -2 log likelihood
        self._hum = _HUM
        self._kept: _Kept | None = None
        self._gaps = self._bridges()
        second = np.diff(self.blocks.x[self.blocks.full], 2)
        white = 1.4826 * float(np.median(np.abs(second - np.median(second)))) / math.sqrt(6.0)
        self._first = max(white, _LEAST) ** 2
        self.set_noise(np.array([self._first, 0.0, 0.0]))

    @property
    def parameters(self) -> Parameters:
        """The known parameters of the drive."""
        return self.experiment.parameters

    @property
    def size(self) -> int:
        """Number of residuals: parts of Fourier bins, then priors of the hum."""
        return 2 * (len(self.blocks.t) // 2) + self._columns.shape[1] - 1

    @property
    def known(self) -> int:
        """Number of values that were measured."""
        return int(self.blocks.full.sum())

    # -- the model

    def model(self, p: Parameters, clock: Array, width: float = 0.0) -> Seen:
        """Return the means of the model over the blocks. ParameterError, SolverError.

        width is the squared width (`WIDTH`) of the time over which the instrument averages.
        """
        first, t = self.starts[0], self.blocks.t
        fine, nodes, order = self._nodes()
        times = first + (nodes - first) / (1.0 + clock[-1] * RATE)
        sides = self.experiment.simulate(p, self.starts + CLOCK * clock[:-1], times)
        every = np.empty((2, len(nodes)))
        every[:, order] = sides
        (x, v), about = every[:, : len(t)], every[:, len(t) :].reshape(2, -1, _LOOKS)
        bend, spread, extra = bend_of(t, x), self.blocks.spread.copy(), width * WIDTH
        x[fine], v[fine] = about.mean(axis=2)
        spread[fine] = 0.0
        half = 0.5 * (spread + extra)
        return Seen(x + half * bend, v + half * bend_of(t, v), bend)

    def _nodes(self) -> tuple[NDArray[np.int64], Array, NDArray[np.int64]]:
        """Return the blocks about slips, all times to look at in rising order, and that order.

        The force on the runner turns in a slip, where its motion in a block is no parabola.
        """
        made_of = (self.experiment, tuple(self.starts.tolist()))
        if (
            self._kept is not None
            and self._kept[0][0] is made_of[0]
            and self._kept[0][1] == made_of[1]
        ):
            return self._kept[1]
        blocks, near = self.blocks, np.zeros(len(self.blocks.t), bool)
        reach = _ABOUT_SLIP * float(np.median(np.diff(blocks.t)))
        slip, end = self.experiment.slip
        for run, start in zip(self.experiment.runs, self.starts.tolist(), strict=True):
            since = blocks.t - start - slip + reach
            inside = (since > 0.0) & (since < (abs(run.steps) + 0.5) / run.frequency)
            near |= inside & (np.mod(since, 1.0 / run.frequency) < end - slip + 2.0 * reach)
        fine = np.flatnonzero(near & (blocks.spread > 0.0))
        parts = (np.arange(_LOOKS) + 0.5) / _LOOKS - 0.5
        wide = np.sqrt(12.0 * blocks.spread[fine] / (1.0 - _LOOKS**-2))
        nodes = np.concatenate([blocks.t, (blocks.t[fine, None] + wide[:, None] * parts).ravel()])
        order = np.argsort(nodes, kind="stable")
        self._kept = made_of, (fine, nodes[order], order)
        return self._kept[1]

    def clock_derivatives(self, seen: Seen, clock: Array) -> Array:
        """Return the derivatives of x by the clock, (blocks, runs + 1)."""
        starts = self.starts + CLOCK * clock[:-1]
        owner = np.searchsorted(starts[1:], self.blocks.t, side="right")
        rows = [-CLOCK * seen.v * (owner == k) for k in range(len(starts))]
        rows.append(-RATE * seen.v * (self.blocks.t - self.starts[0]))
        return np.column_stack(rows)

    def width_derivative(self, seen: Seen) -> Array:
        """Return the derivative of x by the squared width, (blocks,)."""
        return 0.5 * WIDTH * seen.bend

    def cycles(self, clock: Array) -> Array:
        """Return how many cycles each block is after its run began, (blocks,); nan outside."""
        found = np.full(len(self.blocks.t), np.nan)
        starts = (self.starts + CLOCK * clock[:-1]).tolist()
        for run, start in zip(self.experiment.runs, starts, strict=True):
            place = (self.blocks.t - start) * run.frequency
            inside = (place >= 0.0) & (place < abs(run.steps))
            found[inside] = place[inside]
        return found

    # -- the noise

    def _bridges(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], Array]:
        """Return empty blocks, the full ones beside them, and the part of the second of these."""
        full, t = np.flatnonzero(self.blocks.full), self.blocks.t
        empty = np.flatnonzero(~self.blocks.full)
        after = np.searchsorted(full, empty)
        before, behind = full[after - 1], full[after]
        return empty, before, behind, (t[empty] - t[before]) / (t[behind] - t[before])

    def transform(self, columns: Array) -> Array:
        """Return Fourier bins in units of the noise, real parts above imaginary ones.

        columns has the shape (blocks,) or (blocks, n); the result (2 bins,) or (2 bins, n).
        """
        empty, before, behind, part = self._gaps
        if len(empty):
            columns = columns.copy()
            low, high = columns[before], columns[behind]
            columns[empty] = (low.T + part * (high - low).T).T
        bins = np.fft.rfft(columns, axis=0)[1:]
        bins = (bins.T * self._weights).T
        return np.concatenate([bins.real, bins.imag])

    def white(self, columns: Array) -> Array:
        """Return `transform`, and zeros for the priors, with all errors of the sensor taken out."""
        bins = self.transform(columns)
        rows = np.concatenate([bins, np.zeros((self.size - len(bins), *bins.shape[1:]))])
        return np.asarray(rows - self._basis @ (self._basis.T @ rows))

    def residuals(self, seen: Seen) -> Array:
        """Return the residuals, (size,)."""
        return self.white(self.blocks.x - seen.x)

    def changed(self, change: Array) -> Array:
        """Return the change of the residuals for a change of the model, (size,) or (size, n)."""
        return self.white(-change)

    def left(self, seen: Seen) -> Array:
        """Return the residuals in m, without the errors of the sensor, (blocks,)."""
        left = self.blocks.x - seen.x
        bins = self.transform(left)
        rows = np.concatenate([bins, np.zeros(self.size - len(bins))])
        found = np.linalg.lstsq(self._white_columns, rows, rcond=None)[0]
        left = left - self._columns @ found
        return np.asarray(left - left[self.blocks.full].mean())

    def set_noise(self, power: Array) -> None:
        """Take S(f) = a + b/f + c/f^2 (m^2, f in cycles a block) for the noise of a block."""
        self.noise, count = power, len(self.blocks.t)
        f = np.fft.rfftfreq(count)[1:]
        size = power[0] + power[1] / f + power[2] / f**2
        self.loudness = self.known * float(np.mean(np.log(size / self._first)))
        self._weights = np.sqrt(2.0 / (count * size))
        if count % 2 == 0:
            self._weights[-1] /= math.sqrt(2.0)
        t = self.blocks.t
        place = t - 0.5 * (t[0] + t[-1])
        waves = hum_columns(t - t[0], MAINS)
        order = np.tile(np.repeat(np.arange(1.0, HARMONICS + 1.0), 2), len(MAINS))
        slow = [2.0 * math.pi * _MAINS_OFF * n * place * one
                for n, one in zip(order, waves, strict=True)]  # fmt: skip
        sizes = self._hum / np.tile(order, 2)
        self._columns = np.column_stack([place / (t[-1] - t[0]), *waves, *slow])
        priors = np.concatenate([np.zeros((len(sizes), 1)), np.diag(1.0 / sizes)], axis=1)
        self._white_columns = np.vstack([self.transform(self._columns), priors])
        self._basis = np.linalg.qr(self._white_columns)[0]

    def beside(self) -> tuple[Array, NDArray[np.bool_]]:
        """Return the Fourier bins (Hz) and which lie beside all harmonics of the drive."""
        t = self.blocks.t
        f = np.fft.rfftfreq(len(t), (t[-1] - t[0]) / (len(t) - 1))[1:]
        width, away = _BESIDE / (t[-1] - t[0]), np.ones(len(f), bool)
        for drive in {run.frequency for run in self.experiment.runs}:
            if drive > 3.0 * width:
                away &= (np.abs(f - drive * np.round(f / drive)) > width) | (f < 0.5 * drive)
        return f, away

    def learn(self, seen: Seen) -> None:
        """Fit the noise, and the size of the hum, to the residuals of a good model."""
        left = self.left(seen)
        self._find_hum(seen)
        _, away = self.beside()
        away = away if away.sum() > _FEWEST else np.ones_like(away)
        power = np.abs(np.fft.rfft(left)[1:]) ** 2 / max(self.known, 1)
        every = np.asarray(np.fft.rfftfreq(len(left))[1:], np.float64)
        f, power, count = _gathered(every[away], power[away])
        upper = f > 0.25
        level = max(float(np.mean(power[upper] if upper.any() else power)), _LEAST**2)
        base = np.log([level, level * f[0], level * f[0] ** 2])

        def cost(logs: Array) -> float:
            a, b, c = np.exp(np.clip(base + logs, -120.0, 0.0))
            s = a + b / f + c / f**2
            return float(np.sum(count * (np.log(s) + power / s)) / np.sum(count))

        loud = math.log(max(float(np.mean(power[:_FEWEST])) / level, 1.0)) + 1.0
        options = {"xatol": 0.05, "fatol": 1e-6, "maxfev": 300}
        ends = [
            scipy.optimize.minimize(cost, start, method="Nelder-Mead", options=options)
            for start in ((0.0, -3.0, -3.0), (0.0, loud, -3.0), (0.0, -3.0, loud + 2.0))
        ]
        best = min(ends, key=lambda one: float(one.fun))
        self.set_noise(np.exp(np.clip(base + best.x, -120.0, 0.0)))

    def _find_hum(self, seen: Seen) -> None:
        """Tell which mains the residuals hum with, and widen the prior where they do it loudly."""
        bins = self.transform(self.blocks.x - seen.x)
        rows = np.concatenate([bins, np.zeros(self.size - len(bins))])
        found = np.linalg.lstsq(self._white_columns, rows, rcond=None)[0]
        inverse = np.linalg.pinv(self._white_columns.T @ self._white_columns)
        waves, told = found[1:].reshape(2, len(MAINS), -1)[0], []
        for k, frequency in enumerate(MAINS):
            own = slice(1 + k * 2 * HARMONICS, 1 + (k + 1) * 2 * HARMONICS)
            power = float(found[own] @ np.linalg.solve(inverse[own, own], found[own]))
            if scipy.stats.chi2.sf(power, 2 * HARMONICS) < _HUM_CHANCE:
                told.append(frequency)
        self.mains = tuple(told)
        largest = float(np.hypot(waves[:, 0], waves[:, 1]).max())
        self._hum = max(_HUM, 1.5 * largest) if told else _HUM


def _gathered(f: Array, power: Array) -> tuple[Array, Array, Array]:
    """Return means of frequencies and powers of neighbouring bins, more and more, and how many."""
    edges = np.unique(np.concatenate([
        np.arange(min(_SINGLE, len(f))),
        np.geomspace(_SINGLE, max(len(f), _SINGLE + 1), _GATHERED).astype(np.int64)[:-1],
    ]))  # fmt: skip
    edges = edges[edges < len(f)]
    count = np.diff(edges, append=len(f)).astype(np.float64)
    return np.add.reduceat(f, edges) / count, np.add.reduceat(power, edges) / count, count


#: Lowest bins of a spectrum that are looked at one by one, and groups of all others.
_SINGLE, _GATHERED = 64, 200
#: Chance of a hum as loud where there is none.
_HUM_CHANCE = 1e-4


class Look(Trace):
    """A few blocks of a trace, for quick descents: white noise, and errors of the sensor."""

    #: Noise that is assumed, m; time (s) about a slip that is left out.
    _level, _guard = 3e-9, 5e-6

    def __init__(self, whole: Trace, most: int, cycles: float) -> None:
        """Choose blocks of the first cycles of the first run, without slips."""
        # The low-pass of a sensor takes longer than the axis, and hardly moves an optimum.
        known = whole.parameters.replace(sensor_bandwidth=None)
        self.experiment = replace(whole.experiment, parameters=known)
        self.starts, self.clocks = whole.starts, whole.clocks
        run, t = whole.experiment.runs[0], whole.blocks.t
        begin, end = whole.experiment.unsure
        begin = max(begin, run.start - 1.0 / run.frequency)
        end = min(end, run.start + cycles / run.frequency)
        slip, slip_end = whole.experiment.slip
        since = np.mod(t - run.start - slip_end, 1.0 / run.frequency)
        until = 1.0 / run.frequency - (slip_end - slip) - since
        kept = (t >= begin) & (t <= end) & whole.blocks.full
        outside = kept & (since > self._guard) & (until > self._guard)
        which = np.flatnonzero(outside if outside.sum() > 0.5 * kept.sum() else kept)
        which = which[np.linspace(0, len(which) - 1, min(most, len(which))).astype(np.int64)]
        middle = np.zeros(len(which))  # near enough to the mean of a block here
        self.blocks = Blocks(t[which], whole.blocks.x[which], middle, middle == 0.0, 1)
        self.basis, self._kept = sensor_basis(self.blocks.t), None

    @property
    def size(self) -> int:
        """Number of residuals."""
        return len(self.blocks.t)

    def white(self, columns: Array) -> Array:
        """Return values or columns without errors of the sensor, in units of the noise."""
        return np.asarray((columns - self.basis @ (self.basis.T @ columns)) / self._level)


def sensor_basis(t: Array) -> Array:
    """Return an orthonormal basis of zero, drift, and hum or slow wander at times t (s)."""
    place = (t - t.mean()) / np.ptp(t)
    is_long = np.ptp(t) > 1.0 / MAINS[0]
    slow = hum_columns(t - t[0], MAINS, 1) if is_long else [place**2, place**3]
    return np.linalg.qr(np.column_stack([np.ones_like(t), place, *slow]))[0]
