# SPDX-License-Identifier: Apache-2.0
"""Residuals of a trace and a model, independent of errors of the sensor and its clock.

Linear errors (zero and drift of the sensor, hum of the mains) are projected out of the residuals
for every set of parameters: variable projection (Golub, Pereyra 1973), with the Jacobian of Kaufman
(1975). The prior of the hum adds a residual for each of its columns (ridge regression). The starts
of the runs and the rate of the clock are fitted. An autoregressive model of the noise whitens the
residuals (Yule, Walker).

A measurement shorter than some tenths of a second hardly distinguishes hum of 50 from 60 Hz, and
does not show the error of the mains frequency. A wrong choice biases everything else that is
fitted. So if there is hum, that of both mains is removed, with errors of their frequencies of some
hundredths.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy  # its parts load when they are used, which takes half a second
from numpy.typing import NDArray

from stickslip_ros.identification.bins import Bins
from stickslip_ros.identification.experiment import Experiment
from stickslip_ros.identification.settings import BINS, CURVE
from stickslip_ros.parameters import Parameters
from stickslip_ros.traces.hum import HARMONICS, MAINS, USUAL, hum_columns

Array = NDArray[np.float64]

#: Unit of the starts and of the rate of the clock in the search: s, s/s.
CLOCK, RATE = 1e-6, 1e-5
#: Significance of hum: ratio of the part that each of its columns explains to that of chance; lags
#: for the correlation of neighbouring residuals.
_CLEAR, _LAGS = 4.0, 12
#: Prior standard deviation of the amplitudes in terms of the amplitude found; of the frequency, Hz.
_TIMES, _OFF = 1.5, 0.05


@dataclass(frozen=True)
class Hum:
    """Hum that a measurement has."""

    mains: tuple[float, ...]  #: the mains that it is of, Hz
    middle: float  #: of the measurement, s
    widths: Array  #: standard deviation of the amplitude of each column beforehand, m, (columns,)

    @classmethod
    def of(cls, t: Array, left: Array, mains: tuple[float, ...]) -> Hum | None:
        """Return the hum of some mains (Hz) in residuals (m) at times (s); None without mains."""
        if not mains:
            return None
        columns = np.column_stack([np.ones_like(t), t - t.mean(), *hum_columns(t, mains)])
        found = np.linalg.lstsq(columns, left, rcond=1e-3)[0][2:]
        width = max(USUAL, _TIMES * float(np.abs(found).max()))
        harmonics = np.repeat(np.arange(1.0, HARMONICS + 1.0), 2)
        both = np.tile(width / harmonics, len(MAINS))
        return cls(mains, float(t.mean()), np.concatenate([both, 2.0 * np.pi * _OFF * both]))

    def columns(self, t: Array) -> list[Array]:
        """Return the waves of all mains, and their change with the frequency, at times t (s)."""
        waves = hum_columns(t, MAINS)
        orders = np.tile(np.repeat(np.arange(1, HARMONICS + 1), 2), len(MAINS))
        moved = [k * (t - self.middle) * wave for k, wave in zip(orders, waves, strict=True)]
        return [*waves, *moved]


def hum_in(t: Array, left: Array) -> tuple[float, ...]:
    """Return the mains frequencies (Hz) of significant hum in residuals (m).

    In a short measurement one frequency may fit most of the hum of the other; the second is
    returned, too, if it is still significant after the first is removed.
    """
    place = (t - t.mean()) / np.ptp(t)
    plain = [np.ones_like(t), place]
    found: tuple[float, ...] = ()
    while len(found) < len(MAINS):
        others = [one for one in MAINS if one not in found]
        sizes = [_standing_out(t, left, plain, one) for one in others]
        best = int(np.argmax(sizes))
        if not sizes[best] > _CLEAR:
            break
        found = (*found, others[best])
        plain += hum_columns(t, (others[best],))
    return found


def _standing_out(t: Array, left: Array, plain: list[Array], frequency: float) -> float:
    """Return the significance of a frequency (Hz) besides other columns: 1 is that of chance."""
    known, _ = np.linalg.qr(np.column_stack(plain))
    columns = np.column_stack([*plain, *hum_columns(t, (frequency,))])
    basis, _ = np.linalg.qr(columns)
    before = left - known @ (known.T @ left)
    after = left - basis @ (basis.T @ left)
    noise = float(after @ after) / max(len(t) - columns.shape[1], 1)
    # Neighbouring residuals may go together: what their mean over a while leaves is chance.
    size = float(before @ before - after @ after) / max(noise, 1e-40) / (2 * HARMONICS)
    inflation = 1.0 + 2.0 * float(np.sum(np.maximum(autocorrelation(after, _LAGS)[1:], 0.0)))
    return size / inflation


def autocorrelation(left: Array, most: int) -> Array:
    """Return the autocorrelation at lags from 0 to most, (most + 1,)."""
    power = float(left @ left)
    return np.array([float(left[: len(left) - k] @ left[k:]) / power for k in range(most + 1)])


@dataclass(frozen=True)
class Noise:
    """The noise of the bins: white over sqrt(count), or coloured by a filter."""

    size: float  #: standard deviation of one sample, or of what drives the filter, m
    filter: Array  #: (order + 1,), begins with 1: the filter that makes the noise white


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
        self.kept = np.ones(len(self.bins.t))
        self.starts = np.array([run.start for run in experiment.runs])
        self.clocks = len(self.starts) + 1
        self._kept_basis: tuple[tuple[object, ...], Array] | None = None

    #: Step of central differences by logarithms.
    step = CURVE.trace_stride
    #: Residual of a clock rate of 1 `RATE`, in standard deviations.
    clock_weight = RATE / BINS.rate_deviation

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
        x, v = self.experiment.simulation(parameters, starts).sample(times)
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
        weight = self.kept * np.sqrt(self.bins.count) / self.noise.size
        scaled = (columns.T * weight).T
        if len(self.noise.filter) > 1:
            scaled = scipy.signal.lfilter(self.noise.filter, [1.0], scaled, axis=0)
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
        left = self.unprojected(seen)
        scaled = left * np.sqrt(self.bins.count)
        spread = 1.4826 * float(np.median(np.abs(scaled - np.median(scaled))))
        self.kept = (np.abs(scaled) <= BINS.spike * max(spread, 1e-15)).astype(np.float64)
        self.look_for_hum(seen)
        left = self.unprojected(seen)
        self.noise = coloured(left * np.sqrt(self.bins.count) * self.kept)

    def look_for_hum(self, seen: BinnedModel) -> None:
        """Take out hum of the mains, if there is any."""
        self.hum = None
        left = self.unprojected(seen)
        self.hum = Hum.of(self.bins.t, left, hum_in(self.bins.t, left))

    def forget_noise(self) -> None:
        """Take the noise for white, of the size that it has between neighbours."""
        self.noise = Noise(self.bins.noise, np.ones(1))
        self.kept = np.ones(len(self.bins.t))


def coloured(left: Array) -> Noise:
    """Return the noise of residuals (bins,): order by Akaike's criterion, coefficients by
    Yule-Walker.
    """
    count = len(left)
    power = float(left @ left) / count
    correlation = autocorrelation(left, BINS.order)
    best, score = (power, np.ones(1)), count * math.log(power)
    for order in range(1, min(BINS.order, count // BINS.per_order) + 1):
        own = scipy.linalg.solve_toeplitz(correlation[:order], correlation[1 : order + 1])
        rest = power * (1.0 - float(own @ correlation[1 : order + 1]))
        if rest <= 0.0:
            break
        found = count * math.log(rest) + 2.0 * order
        if found < score - BINS.order_gain:
            best, score = (rest, np.concatenate([[1.0], -own])), found
    return Noise(math.sqrt(best[0]), best[1])
