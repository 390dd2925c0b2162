# SPDX-License-Identifier: Apache-2.0
"""Bins of the samples of a measurement, and the times at which a model is evaluated for each bin.

A bin holds the mean of its samples. The mean of the model over a bin follows from two times, one
standard deviation of the sample times before and after the middle, which is exact for a cubic. In
the bins about a slip, where the motion has kinks, the model is evaluated at every sample.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.identification.experiment import Experiment
from stickslip_ros.identification.settings import BINS
from stickslip_ros.traces.even_samples import noise_of, without_spikes
from stickslip_ros.traces.hum import MAINS, hum_columns

Array = NDArray[np.float64]

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
        return (self.count >= BINS.whole * np.median(self.count)).astype(np.float64)

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
        rate = max(BINS.per_ringing * ringing, BINS.fewest / duration)
        if not ringing:
            rate = max(rate, BINS.per_period * fastest)
        width = 1.0 / min(rate, BINS.most / duration)
        number, count, middle, mean = _means(t, x, width)
        fine = max(BINS.fine_per_ringing * ringing, BINS.per_period * fastest)
        fine = min(fine, BINS.most / duration)
        _, few, _, close = _means(t, x, 1.0 / fine)
        spread = np.sqrt(np.maximum(np.bincount(number, (t - middle[number]) ** 2) / count, 0.0))
        dense = np.zeros(len(middle), dtype=bool)  # about the slip of a cycle
        begin, end = experiment.slip[0] - 1.5 * width, experiment.slip[1] + 1.5 * width
        for run in experiment.runs:
            place = (middle - run.start) * run.frequency
            since = np.mod(middle - run.start - begin, 1.0 / run.frequency)
            dense |= (since < end - begin) & (place > 0) & (place < abs(run.steps) + 0.5)
        dense &= count > 2
        nodes, owner, weight = _nodes(t, number, middle, spread, dense, count)
        return cls(middle, mean, count, nodes, owner, weight, _noise(close, few))


def _means(t: Array, x: Array, width: float) -> tuple[NDArray[np.int64], Array, Array, Array]:
    """Return the bin of each sample, and of each bin the samples, mean time and mean position."""
    place = np.floor((t - t[0]) / width).astype(np.int64)
    begins = np.flatnonzero(np.diff(place, prepend=-1))
    count = np.diff(begins, append=len(t)).astype(np.float64)
    number = np.repeat(np.arange(len(begins)), count.astype(np.int64))
    middle = np.add.reduceat(t - t[0], begins) / count + t[0]
    return number, count, middle, np.add.reduceat(x, begins) / count


def _nodes(
    t: Array,
    number: NDArray[np.int64],
    middle: Array,
    spread: Array,
    dense: NDArray[np.bool_],
    count: Array,
) -> tuple[Array, NDArray[np.int64], Array]:
    every = np.maximum(1, np.ceil(count / BINS.looks)).astype(np.int64)
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


def _noise(x: Array, count: Array) -> float:
    """Return the standard deviation (m) of a sample from second differences of bins."""
    second = np.diff(x, 2)
    size = 1.4826 * float(np.median(np.abs(second - np.median(second)))) / _SECOND
    return max(size * float(np.sqrt(np.median(count))), 1e-13)
