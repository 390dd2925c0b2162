# SPDX-License-Identifier: Apache-2.0
"""The noise of a record: white, pink and random walk, a colour of its own, and hum of the mains.

The power of the noise at frequency f is 1 + f_p / f + (f_w / f)^2 times that of the white part.
The corner frequencies f_p and f_w have the highest restricted likelihood (REML; Patterson and
Thompson, Biometrika 58 (1971) 545) of a grid; zero and drift of the sensor are fitted with them.
What is left gets an autoregressive model (Yule, Walker). The filter of least phase with the inverse
amplitude makes the noise white.

There is hum of 50 or 60 Hz if the likelihood with its waves is higher than chance allows, each with
the corner frequencies that suit it: a slow wander alone is no hum. A measurement shorter than some
tenths of a second hardly distinguishes hum of 50 from 60 Hz, and does not show the error of the
mains frequency. A wrong choice biases everything else that is fitted. So if there is hum, that of
both mains is removed, with errors of their frequencies of some hundredths.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy  # its parts load when they are used, which takes half a second

from stickslip_ros.arrays import Array
from stickslip_ros.identification.settings import RECORD
from stickslip_ros.measurement.steps.hum import HARMONICS, MAINS, USUAL, hum_columns


@dataclass(frozen=True)
class Noise:
    """The noise of the bins, scaled by the root of their samples."""

    size: float  #: standard deviation of what drives the filter; of one sample if it is white, m
    filter: Array  #: (order + 1,), begins with 1: the filter that makes the noise white
    #: What white and pink noise and a walk leave, in terms of what a colour of its own leaves.
    structure: float = 1.0

    def whitened(self, columns: Array, kept: Array) -> Array:
        """Return scaled columns (bins,) or (bins, n) in units of the noise, whitened.

        Bins that are not kept (0) are bridged for the filter, and count for nothing.
        """
        if len(self.filter) > 1:
            columns = _filtered(_bridged(columns, kept), self.filter)
        return np.asarray((columns.T * (kept / self.size)).T)

    def power(self, frequency: float) -> float:
        """Return the power (m^2) of a frequency (in those of the bins), white noise having its
        variance.
        """
        wave = np.exp(-2j * math.pi * frequency * np.arange(len(self.filter)))
        return float((self.size / abs(self.filter @ wave)) ** 2)


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
        width = max(USUAL, RECORD.hum_width * float(np.abs(found).max()))
        harmonics = np.repeat(np.arange(1.0, HARMONICS + 1.0), 2)
        both = np.tile(width / harmonics, len(MAINS))
        moved = 2.0 * np.pi * RECORD.mains_off * both
        return cls(mains, float(t.mean()), np.concatenate([both, moved]))

    def columns(self, t: Array) -> list[Array]:
        """Return the waves of all mains, and their change with the frequency, at times t (s)."""
        waves = hum_columns(t, MAINS)
        orders = np.tile(np.repeat(np.arange(1, HARMONICS + 1), 2), len(MAINS))
        moved = [k * (t - self.middle) * wave for k, wave in zip(orders, waves, strict=True)]
        return [*waves, *moved]


def learn(t: Array, left: Array, kept: Array) -> tuple[Noise, tuple[float, ...]]:
    """Return the noise of residuals, scaled by the root of the samples of their bins, and the
    mains (Hz) of their hum.

    t: times of the bins, s; left: residuals, m; kept: 0 for those that count for nothing; (bins,).
    """
    plain = [np.ones_like(t), (t - t.mean()) / np.ptp(t)]
    columns = np.column_stack([*plain, *hum_columns(t, MAINS), left])
    columns = _bridged(columns, kept)
    grams = _Grams(columns)
    waves, count = 2 * HARMONICS, columns.shape[1] - 1
    of_mains = [list(range(2 + k * waves, 2 + (k + 1) * waves)) for k in range(len(MAINS))]
    fitted = [0, 1]
    found: tuple[int, ...] = ()
    best = grams.best(fitted)
    while len(found) < len(MAINS):
        others = [k for k in range(len(MAINS)) if k not in found]
        tried = [(grams.best([*fitted, *of_mains[k]]), k) for k in others]
        nearest, which = min(tried, key=lambda one: one[0][1])
        ratio = len(t) * math.log(best[1] / nearest[1])
        if not ratio > scipy.stats.chi2.isf(RECORD.hum_chance, waves):
            break
        fitted, found, best = [*fitted, *of_mains[which]], (*found, which), nearest
    law = whitener(len(t), *best[0])
    white = _filtered(columns, law)
    rest = white[:, count]
    rest = rest - white[:, fitted] @ np.linalg.lstsq(white[:, fitted], rest, rcond=None)[0]
    own = coloured(rest * kept)
    taps = scipy.signal.fftconvolve(law, own.filter)[: len(t)] if len(own.filter) > 1 else law
    left_by_law = math.sqrt(float(np.mean((rest * kept) ** 2)))
    return Noise(own.size, taps, left_by_law / own.size), tuple(MAINS[k] for k in found)


class _Grams:
    """Likelihoods of corner frequencies, and of columns that are fitted to the residuals."""

    def __init__(self, columns: Array) -> None:
        """Take columns, the last of which is that of the residuals."""
        self._columns, count = columns, len(columns)
        first, last = 0.5 / count, RECORD.highest_corner
        steps = math.ceil(math.log(last / first) / math.log(RECORD.corner_factor))
        self._corners = [0.0, *np.geomspace(first, last, steps + 1).tolist()]
        self._known: dict[tuple[int, int], Array] = {}

    def best(self, fitted: list[int]) -> tuple[tuple[float, float], float]:
        """Return the corners with the highest likelihood, and the sum of squares that is left."""

        def cost(at: tuple[int, int]) -> float:
            squares, volume = self._left(at, fitted)
            return (len(self._columns) - len(fitted)) * math.log(squares) + volume

        every = range(len(self._corners))
        at = min([*((k, 0) for k in every), *((0, k) for k in every)], key=cost)
        while True:  # to a neighbour, as long as one is better
            near = [(at[0] + i, at[1] + k) for i in (-1, 0, 1) for k in (-1, 0, 1)]
            better = min((one for one in near if {*one} <= {*every}), key=cost)
            if better == at:
                break
            at = better
        return (self._corners[at[0]], self._corners[at[1]]), self._left(at, fitted)[0]

    def _left(self, at: tuple[int, int], fitted: list[int]) -> tuple[float, float]:
        """Return the sum of squares left by a fit, and the log-determinant of its columns."""
        if at not in self._known:
            corners = self._corners[at[0]], self._corners[at[1]]
            white = _filtered(self._columns, whitener(len(self._columns), *corners))
            self._known[at] = white.T @ white
        gram = self._known[at]
        own, along = gram[np.ix_(fitted, fitted)], gram[fitted, -1]
        squares = float(gram[-1, -1] - along @ np.linalg.solve(own, along))
        return max(squares, 1e-12 * float(gram[-1, -1])), float(np.linalg.slogdet(own)[1])


@lru_cache(maxsize=256)
def whitener(count: int, pink: float, walk: float) -> Array:
    """Return the filter (count,) of least phase that makes a sum of noises white.

    ``pink`` and ``walk`` are the frequencies, in those of the samples, below which pink noise and a
    random walk exceed the white noise.
    """
    if not pink and not walk:
        return np.ones(1)
    size = 4 * scipy.fft.next_fast_len(count)
    frequency = np.sin(np.pi * np.fft.rfftfreq(size)) / np.pi
    frequency[0] = 0.5 * frequency[1]
    power = 1.0 + pink / frequency + (walk / frequency) ** 2
    cepstrum = np.fft.irfft(-0.5 * np.log(power), size)
    cepstrum[1 : size // 2] *= 2.0
    cepstrum[size // 2 + 1 :] = 0.0
    taps = np.fft.irfft(np.exp(np.fft.rfft(cepstrum)), size)[:count]
    return np.asarray(taps / taps[0])


def _filtered(columns: Array, taps: Array) -> Array:
    if len(taps) == 1:
        return columns
    size = scipy.fft.next_fast_len(len(columns) + len(taps) - 1, real=True)
    spectrum = scipy.fft.rfft(columns.T, size) * scipy.fft.rfft(taps, size)
    return np.asarray(scipy.fft.irfft(spectrum, size)[..., : len(columns)].T)


def _bridged(columns: Array, kept: Array) -> Array:
    """Return columns with straight lines over the bins that are not kept."""
    out = np.flatnonzero(kept == 0.0)
    if not len(out):
        return columns
    inside, bridged = np.flatnonzero(kept), columns.copy()
    bridged[out] = scipy.interpolate.make_interp_spline(inside, columns[inside], 1)(
        np.clip(out, inside[0], inside[-1])
    )
    return bridged


def coloured(left: Array) -> Noise:
    """Return the noise of residuals (bins,): order by Akaike's criterion, coefficients by
    Yule-Walker.
    """
    count = len(left)
    power = float(left @ left) / count
    correlation = autocorrelation(left, RECORD.order)
    best, score = (power, np.ones(1)), count * math.log(power)
    for order in range(1, min(RECORD.order, count // RECORD.per_order) + 1):
        own = scipy.linalg.solve_toeplitz(correlation[:order], correlation[1 : order + 1])
        rest = power * (1.0 - float(own @ correlation[1 : order + 1]))
        if rest <= 0.0:
            break
        found = count * math.log(rest) + 2.0 * order
        if found < score - RECORD.order_gain:
            best, score = (rest, np.concatenate([[1.0], -own])), found
    return Noise(math.sqrt(best[0]), best[1])


def autocorrelation(left: Array, most: int) -> Array:
    """Return the autocorrelation at lags from 0 to most, (most + 1,)."""
    power = float(left @ left)
    return np.array([float(left[: len(left) - k] @ left[k:]) / power for k in range(most + 1)])
