# SPDX-License-Identifier: Apache-2.0
"""The ringing of the runner after a slip: its frequency and damping, from samples of the position.

Between two slips the runner follows a slow trend and rings down on its elastic contact:

    x(t) = a + b t + c t^2 + exp(-d t) (p cos 2 pi f t + q sin 2 pi f t)

Frequency f and decay d are common to all cycles and found by least squares; the linear coefficients
(a, b, c, p, q) are those of each cycle. The sampling may be uneven.

A slip releases the contact and pulls the runner back: it moves to a new equilibrium and rings about
it. This shows when the slips of a motion begin. With tau the time since the start of a slip, and
omega and delta those of the ringing,

    x = -A (1 - exp(-delta tau) (cos(omega tau) - c delta / omega sin(omega tau))).

A purely elastic contact would give c = 1: the damping pushes, too. In a slip of the CEIM the
asperities yield meanwhile, and c = 3 gives the same onset for runs that differ in damping only.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy  # its parts load when they are used, which takes half a second
from numpy.typing import NDArray

from stickslip_ros.traces.even_samples import correlation_time

Array = NDArray[np.float64]
#: Times (s, from 0) and positions (m) of one cycle between two slips.
Window = tuple[Array, Array]
#: Times, positions without their slow trend, and an orthonormal basis of trends, (samples, 3).
_Flat = tuple[Array, Array, Array]

#: Periods of ringing that a window has to hold, and largest damping ratio that counts as ringing.
_FEWEST_PERIODS, _DAMPED_OUT = 1.5, 0.3
#: Highest frequency that samples can show, as part of the sampling rate; samples of a swing that
#: determine its decay, at least.
_HIGHEST, _DETERMINING = 0.45, 4.0
#: Ringing is visible if it explains this many times the sum of squares that chance would explain,
#: and its frequency has at most this relative error.
_CLEAR_GAIN, _UNCERTAIN = 25.0, 0.02
#: Cycles that take part in the fit, first samples of each, samples of a window's spectrum.
_CYCLES, _SAMPLES, _SPECTRUM = 20, 20_000, 4096
#: Decays after which nothing is left of the ringing.
_GONE = 6.0


@dataclass(frozen=True)
class Ringing:
    """A damped oscillation."""

    frequency: float  #: Hz, damping included
    decay: float  #: 1/s, sigma_1 / (2 m) for a runner on its elastic contact
    frequency_error: float = math.nan  #: standard error, Hz
    decay_error: float = math.nan  #: standard error, 1/s; inf where the decay is not determined

    @property
    def damping_ratio(self) -> float:
        """Damping ratio: the share of the critical damping."""
        return self.decay / math.hypot(self.decay, 2.0 * math.pi * self.frequency)

    @property
    def damping_ratio_error(self) -> float:
        """Standard error of the damping ratio."""
        return self.decay_error / math.hypot(self.decay, 2.0 * math.pi * self.frequency)

    def columns(self, t: Array) -> Array:
        """Return cosine and sine part at times t (s), shape (samples, 2)."""
        swing = np.exp(complex(-self.decay, 2.0 * math.pi * self.frequency) * t)
        return swing.view(np.float64).reshape(-1, 2)


def fit_ringing(windows: Sequence[Window]) -> Ringing | None:
    """Fit the common ringing of all windows; None if none is visible.

    The first fit uses whole windows. A second one leaves out the first period, in which the contact
    may still slide, and the time after the ringing has died away. What is left of the sliding is as
    much as another period less makes of it: of 133 traces integrated apart, the errors with that
    (two of them) hold 95 % of the decays; without it, 76 %.
    """
    # Every second sample of a slow cycle would show another frequency; later ones do not ring.
    windows = [(t[:_SAMPLES], x[:_SAMPLES]) for t, x in _spread(windows)]
    first = _fit_from(windows, None)
    if first is None:
        return None
    period = 1.0 / first.frequency
    last = period + max(_GONE / max(first.decay, 1e-9), 4.0 * period)
    found = _fit_from([_cut(window, period, last) for window in windows], first) or first
    later = _fit_from([_cut(window, 2.0 * period, last) for window in windows], found)
    interval = max(float(np.median(np.diff(t))) for t, _ in windows)
    if later is None or found.frequency * interval * _DETERMINING > 1.0:
        return replace(found, decay_error=math.inf)
    return replace(
        found,
        frequency_error=math.hypot(found.frequency_error, later.frequency - found.frequency),
        decay_error=math.hypot(found.decay_error, later.decay - found.decay),
    )


def _fit_from(windows: Sequence[Window], start: Ringing | None) -> Ringing | None:
    flat = [_without_trend(t, x) for t, x in windows if len(t) >= 8]
    if not flat:
        return None
    span = float(np.median([t[-1] for t, *_ in flat]))
    lowest = _FEWEST_PERIODS / span
    if start is None:
        start = _from_spectrum(flat, span, lowest)
    elif start.frequency < 2.0 * lowest:
        return None
    if start is None:
        return None

    size = float(np.std(_residuals(flat, None)))
    if size == 0.0:
        return None

    def residuals(scaled: Array) -> Array:
        ringing = Ringing(scaled[0] * lowest, scaled[1] * lowest)
        return _residuals(flat, ringing) / size  # of order one, for the fit to know its end

    # Noise may make the decay of a first fit vanish or less; its scale has to be above 0.
    scaled = np.array([start.frequency / lowest, max(start.decay / lowest, 0.1)])
    found = scipy.optimize.least_squares(
        residuals, scaled, bounds=([1.0, -1.0], [np.inf, np.inf]), x_scale=scaled
    )
    ringing = Ringing(float(found.x[0] * lowest), float(found.x[1] * lowest))
    return _if_clear(flat, ringing, found.jac / lowest * size)


def _if_clear(windows: Sequence[_Flat], ringing: Ringing, jacobian: Array) -> Ringing | None:
    """Return a ringing with its errors; None if it does not stand out of the residuals."""
    left = _residuals(windows, ringing)
    with_ringing = float(left @ left)
    without = float(np.sum(_residuals(windows, None) ** 2))
    samples = sum(len(t) for t, *_ in windows)
    free = samples - 5 * len(windows) - 2
    if free < 1 or not -0.01 < ringing.damping_ratio < _DAMPED_OUT:
        return None
    interval = max(float(np.median(np.diff(t))) for t, *_ in windows)
    if ringing.frequency * interval > _HIGHEST:
        return None
    chance = with_ringing / free
    gain = (without - with_ringing) / (2 * len(windows) + 2)
    if gain < _CLEAR_GAIN * chance or gain == 0.0:
        return None
    normal = jacobian.T @ jacobian
    known = float(np.linalg.det(normal))
    if not chance * normal[1, 1] < known * (_UNCERTAIN * ringing.frequency) ** 2:
        return None
    # Neighbouring residuals that go together tell as much as one of them.
    errors = np.sqrt(correlation_time(left) * chance * np.diag(normal)[::-1] / known)
    return replace(ringing, frequency_error=float(errors[0]), decay_error=float(errors[1]))


def _without_trend(t: Array, x: Array) -> _Flat:
    scaled = t / t[-1]
    basis, _ = np.linalg.qr(np.column_stack([np.ones_like(t), scaled, scaled * scaled]))
    return t, x - basis @ (basis.T @ x), basis


def _residuals(windows: Sequence[_Flat], ringing: Ringing | None) -> Array:
    parts = []
    for t, x, trends in windows:
        if ringing is not None:
            columns = ringing.columns(t)
            swings = columns - trends @ (trends.T @ columns)
            x = x - swings @ (np.linalg.pinv(swings.T @ swings) @ (swings.T @ x))
        parts.append(x)
    return np.concatenate(parts)


def _from_spectrum(windows: Sequence[_Flat], span: float, lowest: float) -> Ringing | None:
    """Return where to start: the peak of the spectra, with the decay that suits it best."""
    interval = float(np.median([np.median(np.diff(t)) for t, *_ in windows]))
    count = int(np.clip(span / interval, 16, _SPECTRUM))
    grid = np.linspace(0.0, span, count)
    power = np.zeros(2 * count + 1)
    for t, x, _ in windows:
        even = np.interp(grid, t, x)
        even = even - np.polynomial.Polynomial.fit(grid, even, 2)(grid)
        power += np.abs(np.fft.rfft(even, 4 * count)) ** 2
    frequency = np.fft.rfftfreq(4 * count, span / (count - 1))
    power[frequency < lowest] = 0.0
    if not power.max() > 0.0:
        return None
    peak = float(frequency[int(np.argmax(power))])
    trials = [Ringing(peak, factor / span) for factor in (0.3, 1.0, 3.0, 10.0, 30.0)]
    trials = [trial for trial in trials if trial.damping_ratio < _DAMPED_OUT]
    return min(trials, key=lambda one: float(np.sum(_residuals(windows, one) ** 2)), default=None)


def _spread(windows: Sequence[Window]) -> list[Window]:
    if not windows:
        return []
    return [windows[k] for k in np.unique(np.linspace(0, len(windows) - 1, _CYCLES).astype(int))]


def _cut(window: Window, first: float, last: float) -> Window:
    t, x = window
    kept = (t >= first) & (t <= last)
    return t[kept] - first, x[kept]


#: c above.
PUSH = 3.0
#: Range of the search as part of a period of the ringing, and places tried in it first.
_ONSET_REACH, _ONSET_PLACES = 0.3, 13
#: Part of a period of the drive by which the window of a cycle begins before its slip.
_CYCLE_BEFORE = 0.3
#: Approximate number of samples for the onsets, and number of their cycles if there are enough.
_ONSET_SAMPLES, _ONSET_CYCLES = 20_000, 8
#: Added to what is fitted: far more than it reaches.
_AWAY = 10.0


@dataclass(frozen=True)
class Onset:
    """How much later than expected the slips begin: shift + drift (t - middle)."""

    shift: float  #: s
    drift: float  #: s/s
    shift_error: float  #: standard uncertainty, s


def cycle_of(t: Array, slips: Array, period: float) -> NDArray[np.int64]:
    """Return the number of the cycle that each time (s) lies in; a cycle holds its slip inside."""
    return np.searchsorted(slips - _CYCLE_BEFORE * period, t).astype(np.int64)


def thin_samples(t: Array, x: Array, slips: Array, period: float) -> tuple[Array, Array]:
    """Return whole cycles with a limited number of samples, spread over the motion.

    If there are few cycles with very many samples, all cycles stay, with every n-th sample.
    """
    cycle = cycle_of(t, slips, period)
    share = len(t) // _ONSET_SAMPLES + 1
    apart = min(share, max(1, len(slips) // _ONSET_CYCLES))
    kept = np.flatnonzero(cycle % apart == 0)[:: -(-share // apart)]
    return t[kept], x[kept]


def detrend(t: Array, columns: list[Array], cycle: NDArray[np.int64]) -> list[Array]:
    """Return the columns without their mean and slope in each cycle."""
    count = np.maximum(np.bincount(cycle), 1)
    time = t - (np.bincount(cycle, t) / count)[cycle]
    square = np.bincount(cycle, time * time)
    square[square == 0.0] = 1.0
    result = []
    for column in columns:
        about = column - (np.bincount(cycle, column) / count)[cycle]
        slope = np.bincount(cycle, about * time) / square
        result.append(about - slope[cycle] * time)
    return result


def find_onset(
    t: Array,
    x: Array,
    slips: Array,
    period: float,
    ringing: Ringing,
    drift: bool = False,
    middle: float = 0.0,
    before: float = _ONSET_REACH,
) -> Onset:
    """Fit the answer to all slips of a motion; slips and middle (s) by the same clock as t.

    before is how much earlier than expected a slip may be, in periods of the ringing.
    """
    cycle = cycle_of(t, slips, period)
    (position,) = detrend(t, [x], cycle)
    omega = 2.0 * math.pi * ringing.frequency

    def left(trial: Array) -> Array:
        begin = slips + trial[0] / omega
        if drift:
            begin = begin + trial[1] / omega * (slips - middle) / (slips[-1] - slips[0] + period)
        number = np.searchsorted(begin, t, side="right") - 1
        began = number >= 0
        after = np.where(began, t - begin[number], 0.0)
        cosine, sine = ringing.columns(after).T
        answer = began * (1.0 - cosine + PUSH * ringing.decay / omega * sine)
        (answer,) = detrend(t, [answer], cycle)
        size = float(answer @ answer)  # 0 for a place before all samples of the slips
        return np.asarray(position - answer * (answer @ position) / size) if size else position

    # Trials are angles of the ringing: of order one.
    reach = 2.0 * math.pi * _ONSET_REACH
    zeros = [0.0] * drift
    count = round(_ONSET_PLACES * (before + _ONSET_REACH) / (2.0 * _ONSET_REACH))
    places = np.linspace(-2.0 * math.pi * before, reach, count)
    first = min(places, key=lambda place: float(np.sum(left(np.array([place, *zeros])) ** 2)))
    scale = float(np.std(position)) or 1.0
    # Steps of the derivative are parts of a trial: of one near 0, as where all agrees, a step would
    # be lost to rounding.
    found = scipy.optimize.least_squares(
        lambda moved: left(moved - _AWAY) / scale,
        np.array([first, *zeros]) + _AWAY,
        jac="3-point",
        diff_step=1e-3 / _AWAY,
        xtol=1e-6 / _AWAY,
        ftol=1e-10,
    )
    jacobian, rest = found.jac, found.fun
    # Cycles count as independent of each other; samples do not, because they share the ringing.
    parts = np.stack([np.bincount(cycle, column * rest) for column in jacobian.T], axis=1)
    inverse = np.linalg.inv(jacobian.T @ jacobian)
    spread = inverse @ (parts.T @ parts) @ inverse
    best = found.x - _AWAY
    slope = best[1] / omega / (slips[-1] - slips[0] + period) if drift else 0.0
    return Onset(float(best[0]) / omega, float(slope), math.sqrt(spread[0, 0]) / omega)
