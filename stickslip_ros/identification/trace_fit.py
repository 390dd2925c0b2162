# SPDX-License-Identifier: Apache-2.0
"""Residuals of a trace and a model, independent of errors of the sensor and its clock.

Linear errors (zero and drift of the sensor, hum of the mains) are projected out of the residuals
for every set of parameters: variable projection (Golub, Pereyra 1973), with the Jacobian of Kaufman
(1975). The prior of the hum adds a residual for each of its columns (ridge regression). The starts
of the runs and the rate of the clock are fitted. A model of the noise whitens the residuals.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.identification.bins import Bins
from stickslip_ros.identification.experiment import Experiment
from stickslip_ros.identification.noise import Hum, Noise, learn
from stickslip_ros.identification.settings import BINS, CURVE
from stickslip_ros.parameters import Parameters

Array = NDArray[np.float64]

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
            self.noise, mains = learn(self.bins, left, self.kept)
            self.hum = Hum.of(self.bins.t, left, mains)
            white = self.residuals(seen)[0][: len(left)]  # zero, drift and hum are no spikes
            spread = BINS.spike * 1.4826 * float(np.median(np.abs(white - np.median(white))))
            spikes = np.abs(white) > max(spread, 1e-15)
            if not spikes.any():
                break
            self.kept = np.where(spikes, 0.0, self.kept)

    def look_for_hum(self, seen: BinnedModel) -> None:
        """Take out hum of the mains, if there is any."""
        self.hum = None
        _, mains = learn(self.bins, self.bins.x - seen.x, self.kept)
        self.hum = Hum.of(self.bins.t, self.unprojected(seen), mains)

    def forget_noise(self) -> None:
        """Take the noise for white, of the size that it has between neighbours."""
        self.noise = Noise(self.bins.noise, np.ones(1))
        self.kept = self.bins.whole
