# SPDX-License-Identifier: Apache-2.0
"""Residuals of a trace and a model, independent of errors of the sensor and its clock.

Linear errors (zero and drift of the sensor, hum of the mains) are projected out of the residuals
for every set of parameters: variable projection (Golub, Pereyra 1973), with the Jacobian of Kaufman
(1975). The prior of the hum adds a residual for each of its columns (ridge regression). The starts
of the runs and the rate of the clock are fitted. A model of the noise whitens the residuals.

A bin holds the mean of its samples. The mean of the model over a bin follows from two times, one
standard deviation of the sample times before and after the middle, which is exact for a cubic. In
the bins about a slip, where the motion has kinks, the model is evaluated at every sample.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy  # its parts load when they are used, which takes half a second
from numpy.typing import NDArray

from stickslip_ros.arrays import Array
from stickslip_ros.identification.experiment import Experiment
from stickslip_ros.identification.noise import Hum, Noise, learn
from stickslip_ros.identification.settings import DESCENT, RECORD
from stickslip_ros.measurement.steps.hum import MAINS, hum_columns
from stickslip_ros.measurement.steps.noise import noise_of, without_spikes
from stickslip_ros.parameters import Parameters

#: Ratio of the second differences of white noise to the noise.
_SECOND = 6.0**0.5


@dataclass(frozen=True)
class Bins:
    """Means of neighbouring samples; arrays have shape (bins,) unless said otherwise."""

    t: Array  #: mean time, s
    x: Array  #: mean position, m
    count: Array  #: samples
    nodes: Array  #: times at which the model is evaluated, rising, (nodes,)
    owner: NDArray[np.int64]  #: bin of each node, (nodes,)
    weight: Array  #: part of each node in the mean of its bin, (nodes,)
    noise: float  #: standard deviation of one sample, as far as it changes between bins, m

    @property
    def scale(self) -> float:
        """Root of the samples in a bin, by which white noise is smaller. The last digits of bin
        edges must not enter: where bins held 9 and 10 samples by turns, a slow wander would jump.
        """
        return float(np.sqrt(np.median(self.count)))

    @property
    def whole(self) -> Array:
        """1 for each bin, 0 for those at gaps, whose few samples count as none, (bins,)."""
        return (self.count >= RECORD.whole * np.median(self.count)).astype(np.float64)

    def means(self, values: Array) -> Array:
        """Return the mean over each bin of values at the nodes, (bins,)."""
        found = np.bincount(self.owner, self.weight * values, minlength=len(self.t))
        return found.astype(np.float64, copy=False)

    def some(self, kept: NDArray[np.bool_], most: int) -> Bins:
        """Return the bins that are kept, evenly chosen ones if there are more than most."""
        which = np.flatnonzero(kept)
        if len(which) > most:
            which = which[np.linspace(0, len(which) - 1, most).astype(np.int64)]
        chosen = np.zeros(len(self.t), dtype=bool)
        chosen[which] = True
        number = np.cumsum(chosen) - 1
        nodes = chosen[self.owner]
        return Bins(
            self.t[which], self.x[which], self.count[which], self.nodes[nodes],
            number[self.owner[nodes]], self.weight[nodes], self.noise,
        )  # fmt: skip

    def of_sensor(self) -> Array:
        """Return an orthonormal basis of zero, drift and hum of a sensor, (bins, n)."""
        span = max(float(np.ptp(self.t)), 1e-12)
        place = (self.t - self.t.mean()) / span
        # Less than a period of the mains is a slow drift.
        hum = hum_columns(self.t, MAINS) if span > 1.0 / min(MAINS) else [place**2, place**3]
        return np.linalg.qr(np.column_stack([np.ones_like(place), place, *hum]))[0]

    @classmethod
    def of(cls, experiment: Experiment) -> Bins:
        """Return the bins of a measurement, its spikes left out."""
        t, x = experiment.motion.t, experiment.motion.x
        kept = without_spikes(x, noise_of(x))
        t, x = t[kept], x[kept]
        fastest = max(run.frequency for run in experiment.runs)
        ringing = experiment.ringing.frequency if experiment.ringing else 0.0
        duration = float(t[-1] - t[0])
        rate = max(RECORD.bins_a_swing * ringing, RECORD.fewest_bins / duration)
        if not ringing:
            rate = max(rate, RECORD.bins_a_period * fastest)
        width = 1.0 / min(rate, RECORD.most_bins / duration)
        number, count, middle, mean = _means(t, x, width)
        fine = max(RECORD.fine_bins_a_swing * ringing, RECORD.bins_a_period * fastest)
        fine = min(fine, RECORD.most_bins / duration)
        _, few, _, close = _means(t, x, 1.0 / fine)
        spread = np.sqrt(np.maximum(np.bincount(number, (t - middle[number]) ** 2) / count, 0.0))
        dense = np.zeros(len(middle), dtype=bool)  # about the slip of a cycle
        about = RECORD.about_slips * width
        begin, end = experiment.slip[0] - about, experiment.slip[1] + about
        for run in experiment.runs:
            place = (middle - run.start) * run.frequency
            since = np.mod(middle - run.start - begin, 1.0 / run.frequency)
            dense |= (since < end - begin) & (place > 0) & (place < abs(run.steps) + 0.5)
        dense &= count > 2
        nodes, owner, weight = _nodes(t, number, middle, spread, dense)
        # Second differences of the finer bins show the noise of a sample.
        second = scipy.stats.median_abs_deviation(np.diff(close, 2), scale="normal") / _SECOND
        noise = max(float(second * np.sqrt(np.median(few))), 1e-13)
        return cls(middle, mean, count, nodes, owner, weight, noise)


def _means(t: Array, x: Array, width: float) -> tuple[NDArray[np.int64], Array, Array, Array]:
    """Return the bin of each sample, and of each bin the samples, mean time and mean position."""
    place = np.floor((t - t[0]) / width).astype(np.int64)
    begins = np.flatnonzero(np.diff(place, prepend=-1))
    count = np.diff(begins, append=len(t)).astype(np.float64)
    number = np.repeat(np.arange(len(begins)), count.astype(np.int64))
    middle = np.add.reduceat(t - t[0], begins) / count + t[0]
    return number, count, middle, np.add.reduceat(x, begins) / count


def _nodes(
    t: Array, number: NDArray[np.int64], middle: Array, spread: Array, dense: NDArray[np.bool_]
) -> tuple[Array, NDArray[np.int64], Array]:
    every = np.maximum(1, np.ceil(np.bincount(number) / RECORD.looks)).astype(np.int64)
    rank = np.arange(len(t)) - np.searchsorted(number, number)
    looked = dense[number] & ((rank - every[number] // 2) % every[number] == 0)
    plain = np.flatnonzero(~dense)
    single = spread[plain] == 0.0
    pair = plain[~single]
    times = np.concatenate(
        [t[looked], middle[plain[single]], middle[pair] - spread[pair], middle[pair] + spread[pair]]
    )
    owner = np.concatenate([number[looked], plain[single], pair, pair])
    order = np.argsort(times, kind="stable")
    times, owner = times[order], owner[order]
    return times, owner, 1.0 / np.bincount(owner, minlength=len(middle))[owner]


#: Unit of the starts and of the rate of the clock in the search: s, s/s.
CLOCK, RATE = 1e-6, 1e-5


@dataclass(frozen=True)
class BinnedModel:
    """Means of the model over the bins, without zero, drift and hum."""

    x: Array  #: m, (bins,)
    v: Array  #: m/s, (bins,)


class TraceFit:
    """One experiment with its nuisances.

    ``clock`` holds the starts of the runs (in microseconds from where they were found) and the
    rate of the measurement's clock (in 1e-5), shape (runs + 1,).
    """

    def __init__(self, experiment: Experiment) -> None:
        """Put the samples into bins."""
        self.experiment = experiment
        self.bins: Bins = Bins.of(experiment)
        self.noise = Noise(self.bins.noise, np.ones(1))
        self.hum: Hum | None = None
        self.kept = self.bins.whole
        self.starts = np.array([run.start for run in experiment.runs])
        self.clocks = len(self.starts) + 1
        self._kept_basis: tuple[tuple[object, ...], Array] | None = None

    #: Step of central differences by logarithms.
    step = DESCENT.trace_difference
    #: Residual of a clock rate of 1 `RATE`, in standard deviations.
    clock_weight = RATE / RECORD.rate_deviation

    @property
    def parameters(self) -> Parameters:
        """The known parameters of the drive."""
        return self.experiment.parameters

    @property
    def size(self) -> int:
        """Number of residuals: of the bins, then of the priors of the hum."""
        return len(self.bins.t) + (len(self.hum.widths) if self.hum else 0)

    @property
    def mains(self) -> tuple[float, ...]:
        """The mains frequencies (Hz) that the measurement hums with."""
        return self.hum.mains if self.hum else ()

    def take(self, experiment: Experiment) -> None:
        """Set an experiment that differs in the starts and steps of its runs."""
        self.experiment = experiment
        self.bins = Bins.of(experiment)

    def model(self, parameters: Parameters, clock: Array) -> BinnedModel:
        """Simulate the model; return its means over the bins. ParameterError, SolverError."""
        rate = clock[-1] * RATE
        reference = self.starts[0]
        times = reference + (self.bins.nodes - reference) / (1.0 + rate)
        starts = self.starts + CLOCK * clock[:-1]
        x, v = self.experiment.simulate(parameters, starts, times)
        return BinnedModel(self.bins.means(x), self.bins.means(v))

    def columns(self) -> Array:
        """Return the columns of the linear errors, (bins, columns): those of the hum first."""
        t = self.bins.t
        place = (t - 0.5 * (t[0] + t[-1])) / (t[-1] - t[0])
        return np.column_stack([*(self.hum.columns(t) if self.hum else ()), np.ones_like(t), place])

    def whitened(self, columns: Array) -> Array:
        """Return values or columns (bins,) or (bins, n) in units of the noise, whitened.

        Zeros for the priors of the hum follow, so that there are `size` rows.
        """
        scaled = self.noise.whitened(self.bins.scale * columns, self.kept)
        found = np.zeros((self.size, *columns.shape[1:]))
        found[: len(scaled)] = scaled
        return found

    def projected(self, change: Array, basis: Array) -> Array:
        """Return the change of the residuals for a change of the model, (bins,) or (bins, n)."""
        white = self.whitened(-change)
        return np.asarray(white - basis @ (basis.T @ white))

    def _white_columns(self) -> Array:
        """Return `columns` whitened, with the priors of the amplitudes of the hum, (size, n)."""
        found = self.whitened(self.columns())
        if self.hum:
            known = np.arange(len(self.hum.widths))
            found[len(self.bins.t) + known, known] = 1.0 / self.hum.widths
        return found

    def _basis(self) -> Array:
        """Return an orthonormal basis of the linear errors, (size, n)."""
        made_of = (self.bins, self.noise, self.kept, self.hum)
        kept = self._kept_basis
        if kept is None or any(a is not b for a, b in zip(kept[0], made_of, strict=True)):
            kept = made_of, np.linalg.qr(self._white_columns())[0]
            self._kept_basis = kept
        return kept[1]

    def residuals(self, seen: BinnedModel) -> tuple[Array, Array]:
        """Return residuals (size,) and an orthonormal basis of the projected errors."""
        basis = self._basis()
        white = self.whitened(self.bins.x - seen.x)
        return white - basis @ (basis.T @ white), basis

    def unprojected(self, seen: BinnedModel) -> Array:
        """Return the residuals in m, not whitened, (bins,)."""
        left = self.bins.x - seen.x
        found, *_ = np.linalg.lstsq(self._white_columns(), self.whitened(left), rcond=None)
        return left - self.columns() @ found

    def clock_derivatives(self, seen: BinnedModel, clock: Array) -> Array:
        """Return the derivatives of x by the clock, (bins, runs + 1)."""
        starts = self.starts + CLOCK * clock[:-1]
        owner = np.searchsorted(starts[1:], self.bins.t, side="right")
        rows = [-CLOCK * seen.v * (owner == k) for k in range(len(starts))]
        rows.append(-RATE * seen.v * (self.bins.t - self.starts[0]))
        return np.column_stack(rows)

    def cycles(self, clock: Array) -> Array:
        """Return how many cycles each bin is after its run began, (bins,); nan outside."""
        found = np.full(len(self.bins.t), np.nan)
        starts = (self.starts + CLOCK * clock[:-1]).tolist()
        for run, start in zip(self.experiment.runs, starts, strict=True):
            place = (self.bins.t - start) * run.frequency
            inside = (place >= 0.0) & (place < abs(run.steps))
            found[inside] = place[inside]
        return found

    def learn_noise(self, seen: BinnedModel) -> None:
        """Estimate spikes, hum and noise from the residuals of a good model."""
        left, self.kept = self.bins.x - seen.x, self.bins.whole
        for _ in range(2):  # once more without the spikes
            self.noise, mains = learn(self.bins.t, self.bins.scale * left, self.kept)
            self.hum = Hum.of(self.bins.t, left, mains)
            white = self.residuals(seen)[0][: len(left)]  # zero, drift and hum are no spikes
            spread = float(scipy.stats.median_abs_deviation(white, scale="normal"))
            spikes = np.abs(white) > max(RECORD.spike * spread, 1e-15)
            without = np.where(spikes, 0.0, self.kept)
            if not spikes.any() or not without.any():  # those that fit nothing are no spikes either
                break
            self.kept = without

    def look_for_hum(self, seen: BinnedModel) -> None:
        """Take out hum of the mains, if there is any."""
        self.hum = None
        _, mains = learn(self.bins.t, self.bins.scale * (self.bins.x - seen.x), self.kept)
        self.hum = Hum.of(self.bins.t, self.unprojected(seen), mains)

    def forget_noise(self) -> None:
        """Take the noise for white, of the size that it has between neighbours."""
        self.noise = Noise(self.bins.noise, np.ones(1))
        self.kept = self.bins.whole
