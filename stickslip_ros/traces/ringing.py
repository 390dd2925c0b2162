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

from stickslip_ros.arrays import Array
from stickslip_ros.traces.even_samples import correlation_time

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
#: Cycles that take part in the fit, first samples of each, and fewest of a window; samples of a
#: window's spectrum, and times as many frequencies as it has.
_CYCLES, _SAMPLES, _FEWEST, _SPECTRUM, _FINER = 20, 20_000, 8, (16, 4096), 4
#: Decays that are tried first, in windows; the least one, in units of the least frequency, and the
#: least damping ratio, as noise may make it negative. Unknowns of a window: trend and swing.
_DECAYS, _LEAST_DECAY, _UNDAMPED, _UNKNOWNS = (0.3, 1.0, 3.0, 10.0, 30.0), 0.1, -0.01, 5
#: Decays after which nothing is left of the ringing; samples of a swing that are kept.
_GONE, _DENSE = 6.0, 40.0
#: Part by which sliding moves the frequency of windows that hold no more than a first swing.
_SLIDES = 0.005
#: Swings that count however fast they decay; samples by which the clock of slips may be off,
#: and rounds in which that is looked for, each finer.
_SWINGS, _OFF, _ROUNDS = 4.0, 1.5, 2
#: No axis rings faster (Hz): 1 g on 16 N/µm; twice the logarithm of how many times as likely a
#: frequency has to be as a faster one.
_FASTEST, _SURELY = 2e4, 2.0 * math.log(1e3)


@dataclass(frozen=True)
class Ringing:
    """A damped oscillation."""

    frequency: float  #: Hz, damping included
    decay: float  #: 1/s, sigma_1 / (2 m) for a runner on its elastic contact
    frequency_error: float = math.nan  #: standard error, Hz
    decay_error: float = math.nan  #: standard error, 1/s; inf where the decay is not determined
    folded: bool = False  #: whether the samples may show a faster one (`may_be_folded`)

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
    windows = _some(windows)
    if not windows:
        return None
    span = float(np.median([t[-1] for t, _ in windows]))
    peak = _from_spectrum(windows, span)
    if peak is None:
        return None
    windows = [thin_swings(t, x, peak) for t, x in windows]
    first = _fit_from(windows, peak, span)
    if first is None:
        return None
    period = 1.0 / first.frequency
    last = period + max(_GONE / max(first.decay, 1e-9), _SWINGS * period)
    found = _fit_from([_cut(window, period, last) for window in windows], first) or first
    later = _fit_from([_cut(window, 2.0 * period, last) for window in windows], found)
    interval = max(float(np.median(np.diff(t))) for t, _ in windows if len(t) > 1)
    other = first if later is None else later
    by_sliding = other.frequency - found.frequency if other is not found else _SLIDES * peak
    if later is None or found.frequency * interval * _DETERMINING > 1.0:
        error = math.inf
    else:
        error = math.hypot(found.decay_error, later.decay - found.decay)
    return replace(
        found,
        frequency_error=math.hypot(found.frequency_error, by_sliding),
        decay_error=error,
    )


def _some(windows: Sequence[Window]) -> list[Window]:
    # Every second sample of a slow cycle would show another frequency; later ones do not ring.
    some = np.unique(np.linspace(0, max(len(windows) - 1, 0), _CYCLES).astype(int))
    chosen = [windows[k] for k in some if k < len(windows)]
    return [(t[:_SAMPLES], x[:_SAMPLES]) for t, x in chosen if len(t) >= _FEWEST]


def may_be_folded(windows: Sequence[Window], ringing: Ringing) -> bool:
    """Return whether a ringing up to `_FASTEST` that sampling folds explains the windows as well.

    At even times the two are the same. But slips lie at other places between the samples each time,
    and only at its own frequency the ringing begins alike after all of them. The clock of the slips
    may be a sample off over the run.
    """
    windows = _some(windows)
    if not windows:
        return False
    interval = max(float(np.median(np.diff(t))) for t, _ in windows)
    multiples = np.arange(1.0, _FASTEST * interval + 2.0) / interval
    others = np.abs(np.concatenate((multiples - ringing.frequency, multiples + ringing.frequency)))
    others = others[others < _FASTEST]
    if not len(others):
        return False
    flat = [_without_trend(t, x) for t, x in windows]
    total = sum(float(x @ x) for _, x, _ in flat)
    about = np.linspace(-_OFF, _OFF, len(windows)) * interval

    def left(frequency: float) -> float:
        """Return the squares left by swings of a frequency that begin alike, at the best clock."""
        poles = [replace(ringing, frequency=frequency).columns(t) for t, *_ in flat]
        swings = [
            one - basis @ (basis.T @ one) for one, (*_, basis) in zip(poles, flat, strict=True)
        ]
        waves = [one @ [1.0, 1.0j] for one in swings]
        same_all = [one @ one for one in waves]
        seen_all = [one @ x for one, (_, x, _) in zip(waves, flat, strict=True)]
        size = sum(float(np.vdot(one, one).real) for one in waves)
        half, best, reach = math.ceil(100.0 * frequency * interval), 0.0, 1.0
        for _ in range(_ROUNDS):
            late = best + np.linspace(-reach, reach, 2 * half + 1)
            turn = np.exp(-2j * math.pi * frequency * late[:, None] * about)
            seen, same = turn @ seen_all, turn**2 @ same_all
            # Least squares of a cosine and a sine, which are not at right angles.
            told = size * np.abs(seen) ** 2 - (same.conj() * seen**2).real
            told *= 2.0 / np.maximum(size**2 - np.abs(same) ** 2, 1e-9 * size**2)
            best, reach = float(late[int(np.argmax(told))]), reach / half
        return max(total - float(told.max()), 1e-9 * total)

    samples = sum(len(t) for t, _ in windows)
    least = min(map(left, others.tolist()))
    return samples * math.log(least / left(ringing.frequency)) < _SURELY


def thin_swings(t: Array, x: Array, frequency: float) -> Window:
    """Return means of neighbours, as many as leave `_DENSE` of them in a swing of a frequency."""
    every = int((len(t) - 1) / (max(t[-1] - t[0], 1e-30) * frequency * _DENSE)) if len(t) else 1
    if every < 2:
        return t, x
    count = len(t) // every * every
    return t[:count].reshape(-1, every).mean(axis=1), x[:count].reshape(-1, every).mean(axis=1)


def _fit_from(
    windows: Sequence[Window], start: Ringing | float, whole: float = 0.0
) -> Ringing | None:
    """Fit the ringing from a start, or from its frequency (Hz) in windows of whole length (s)."""
    flat = [_without_trend(t, x) for t, x in windows if len(t) >= _FEWEST]
    if not flat:
        return None
    lowest = _FEWEST_PERIODS / (whole or float(np.median([t[-1] for t, *_ in flat])))
    if isinstance(start, Ringing):
        if start.frequency < 2.0 * lowest:
            return None
    else:
        trials = [Ringing(start, factor / whole) for factor in _DECAYS]
        trials = [trial for trial in trials if trial.damping_ratio < _DAMPED_OUT]
        if not trials:
            return None
        start = min(trials, key=lambda one: float(np.sum(_residuals(flat, one) ** 2)))

    size = float(np.std(_residuals(flat, None)))
    if size == 0.0:
        return None

    def residuals(scaled: Array) -> Array:
        ringing = Ringing(scaled[0] * lowest, scaled[1] * lowest)
        return _residuals(flat, ringing) / size  # of order one, for the fit to know its end

    # Noise may make the decay of a first fit vanish or less; its scale has to be above 0.
    scaled = np.array([start.frequency / lowest, max(start.decay / lowest, _LEAST_DECAY)])
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
    free = samples - _UNKNOWNS * len(windows) - 2
    if free < 1 or not _UNDAMPED < ringing.damping_ratio < _DAMPED_OUT:
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
            first, second = (columns - trends @ (trends.T @ columns)).T
            x = _without(x, first)
            x = _without(x, _without(second, first))
        parts.append(x)
    return np.concatenate(parts)


def _without(x: Array, column: Array) -> Array:
    square = float(column @ column)
    return x - column * (float(column @ x) / square) if square > 0.0 else x


def _from_spectrum(windows: Sequence[Window], span: float) -> float | None:
    """Return the frequency (Hz) of the peak of the spectra of windows of some length (s)."""
    interval = float(np.median([np.median(np.diff(t)) for t, _ in windows]))
    count = int(np.clip(span / interval, *_SPECTRUM))
    grid = np.linspace(0.0, span, count)
    size = scipy.fft.next_fast_len(_FINER * count, real=True)
    basis, _ = np.linalg.qr(np.vander(grid / span, 3))
    even = np.array([np.interp(grid, t, x - x[0]) for t, x in windows])
    even -= (even @ basis) @ basis.T
    power = np.sum(np.abs(scipy.fft.rfft(even, size)) ** 2, axis=0)
    frequency = np.fft.rfftfreq(size, span / (count - 1))
    power[frequency < _FEWEST_PERIODS / span] = 0.0
    return float(frequency[int(np.argmax(power))]) if power.max() > 0.0 else None


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
#: So many samples of a swing show about where they are.
_ONSET_SEEN = 12.0
#: Added to what is fitted: far more than it reaches. Steps of the derivative are parts of a trial:
#: of one near 0, as where all agrees, a step would be lost to rounding.
_AWAY = 10.0
_DESCENT = {"diff_step": 1e-3 / _AWAY, "xtol": 1e-6 / _AWAY, "ftol": 1e-10}


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

    def left(trial: Array, part: slice = slice(None)) -> Array:
        begin = slips + trial[0] / omega
        if drift:
            begin = begin + trial[1] / omega * (slips - middle) / (slips[-1] - slips[0] + period)
        time, seen = t[part], position[part]
        bounds = np.concatenate(([0], np.searchsorted(time, begin), [len(time)]))
        after = time - np.repeat(np.append(time[:1], begin), np.diff(bounds))
        cosine, sine = ringing.columns(after).T
        answer = 1.0 - cosine + PUSH * ringing.decay / omega * sine
        answer[: bounds[1]] = 0.0
        (answer,) = detrend(time, [answer], cycle[part])
        size = float(answer @ answer)  # 0 for a place before all samples of the slips
        return np.asarray(seen - answer * (answer @ seen) / size) if size else seen

    # Trials are angles of the ringing: of order one.
    reach = 2.0 * math.pi * _ONSET_REACH
    zeros = [0.0] * drift
    count = round(_ONSET_PLACES * (before + _ONSET_REACH) / (2.0 * _ONSET_REACH))
    places = np.linspace(-2.0 * math.pi * before, reach, count)
    dense = 1.0 / (float(np.median(np.diff(t))) * ringing.frequency * _ONSET_SEEN)
    few = slice(None, None, max(1, int(dense)))
    tried = [np.array([place, *zeros]) for place in places]
    first = min(tried, key=lambda one: float(np.sum(left(one, few) ** 2)))
    scale = float(np.std(position)) or 1.0
    found = scipy.optimize.least_squares(
        lambda moved: left(moved - _AWAY) / scale,
        first + _AWAY,
        jac="3-point",
        **_DESCENT,
    )
    jacobian, rest = found.jac, found.fun
    # Cycles count as independent of each other; samples do not, because they share the ringing.
    parts = np.stack([np.bincount(cycle, column * rest) for column in jacobian.T], axis=1)
    inverse = np.linalg.inv(jacobian.T @ jacobian)
    spread = inverse @ (parts.T @ parts) @ inverse
    best = found.x - _AWAY
    slope = best[1] / omega / (slips[-1] - slips[0] + period) if drift else 0.0
    return Onset(float(best[0]) / omega, float(slope), math.sqrt(spread[0, 0]) / omega)
