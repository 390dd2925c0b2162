# SPDX-License-Identifier: Apache-2.0
"""The ringing of the contact after slips, fitted as a damped sinusoid."""

from __future__ import annotations

import contextlib
import math
from dataclasses import dataclass, replace

import numpy as np
import scipy  # its parts load when they are used, which takes half a second

from stickslip_ros.base.arrays import Array
from stickslip_ros.measurement.steps.record import Level, smooth
from stickslip_ros.measurement.steps.settings import SETTINGS

#: Samples of a fit at least; times that frequencies tried are finer than its spectrum; decays that
#: are tried, over the time that is fitted.
_FEWEST, _FINER, _DECAYS = 12, 8, (1.0, 3.0, 8.0, 20.0)
#: Swings from which on the first one is left out; part by which the frequency is the same without;
#: decays after which nothing of it is left; swings that are looked at.
_SWINGS_LATER, _SAME, _GONE, _SWINGS_LOOKED_AT = 6.0, 0.05, 6.0, 30.0
#: Part of the sampling rate up to which frequencies are tried, and told.
_TRIED, _TOLD = 0.4, 0.38
#: Parts by which a contact rings off its linear frequency in a rest and in a cycle, and by which
#: both may differ; by which sliding makes swings die away otherwise; error of a decay times period.
_BEND_IN_REST, _BEND_IN_CYCLE, _DISAGREE = 0.0005, 0.001, 0.02
_BEND_OF_DECAY, _DECAY_ERROR = 0.02, 0.05
#: Swings from which on a cycle shows the ringing by itself.
SWINGS_IN_CYCLE = 8.0


@dataclass(frozen=True)
class Ringing:
    """A damped sinusoid; errors are standard errors, infinite where a value is not to be told."""

    frequency: float  #: Hz
    decay: float  #: 1/s
    frequency_error: float = math.nan  #: Hz
    decay_error: float = math.nan  #: 1/s

    @property
    def damping_ratio(self) -> float:
        """Damping as part of the critical one."""
        return self.decay / math.hypot(self.decay, 2.0 * math.pi * self.frequency)

    @property
    def damping_ratio_error(self) -> float:
        """Standard error of the damping ratio."""
        return self.decay_error / math.hypot(self.decay, 2.0 * math.pi * self.frequency)

    @property
    def swing(self) -> float:
        """Time of one swing, s."""
        return 1.0 / self.frequency

    @property
    def told(self) -> bool:
        """Whether the values are determined; if not, they only help to find slips."""
        return math.isfinite(self.frequency_error)

    def columns(self, t: Array) -> Array:
        """Return cosine and sine of the ringing at times t (s), decaying from 0 on, (times, 2)."""
        wave = np.exp((2j * math.pi * self.frequency - self.decay) * t)
        return np.stack([wave.real, wave.imag], axis=1)


class _DampedWave:
    """Positions (m) over times (s, from 0) as a polynomial and a damped sinusoid.

    Their sizes are always the best: they are projected out (variable projection, Golub and Pereyra,
    SIAM J. Numer. Anal. 10 (1973) 413), so that frequency and decay are left. Positions beside the
    polynomial are parts of their scatter, as the tolerances of the solver are absolute.
    """

    def __init__(self, t: Array, x: Array, order: int) -> None:
        self.t = t
        powers = np.polynomial.polynomial.polyvander(t / max(float(t[-1]), 1e-30), order)
        self._base = np.linalg.qr(powers)[0]
        x = self._beside(x - x[0])
        self.x = x / (float(np.std(x)) or 1.0)

    def _beside(self, columns: Array) -> Array:
        return np.asarray(columns - self._base @ (self._base.T @ columns))

    def sizes(self, log: Array) -> tuple[Array, Array]:
        """Return cosine and sine at time 0 of a log frequency (Hz) and decay, and the residuals."""
        columns = self._beside(Ringing(*np.exp(log).tolist()).columns(self.t))
        square = columns.T @ columns + 1e-300 * np.eye(2)
        size = np.linalg.solve(square, columns.T @ self.x)
        return np.asarray(size), np.asarray(self.x - columns @ size)


def fit_ringing(t: Array, x: Array, longest: float, order: int = 3) -> Ringing | None:
    """Fit a polynomial of an order and a damped sinusoid to x (m) at times t (s).

    longest (s) is the longest swing that is looked for. None where no ringing is clear.
    """
    if len(t) < _FEWEST:
        return None
    t = t - t[0]
    spacing, count = float(np.median(np.diff(t))), len(t)
    model = _DampedWave(t, x, order)
    even = np.linspace(0.0, t[-1], count)
    spread = np.interp(even, t, model.x)
    tried = np.fft.rfftfreq(_FINER * count, even[1])
    lowest = max(1.5 / t[-1], 1.0 / longest)
    inside = np.flatnonzero((tried >= lowest) & (tried <= _TRIED / spacing))
    fits = []
    for decay in np.array(_DECAYS if len(inside) else ()) / t[-1]:
        power = np.abs(np.fft.rfft(np.exp(-decay * even) * spread, _FINER * count))[inside]
        start = [math.log(tried[inside[int(np.argmax(power))]]), math.log(decay)]
        with contextlib.suppress(ValueError, OverflowError, np.linalg.LinAlgError):
            fits.append(scipy.optimize.least_squares(
                lambda log: model.sizes(log)[1], start, x_scale=[0.01, 0.3], max_nfev=40
            ))  # fmt: skip
    if not fits:
        return None
    fit = min(fits, key=lambda one: float(one.cost))
    frequency, decay = (math.exp(min(one, 60.0)) for one in fit.x)
    size, left = model.sizes(fit.x)
    square = float(left @ left)
    like = float(left[1:] @ left[:-1]) / square if square > 0.0 else 0.0
    like = min(max(like, 0.0), 0.95)
    independent = max(count * (1.0 - like) / (1.0 + like) - order - 5.0, 1.0)
    inverse = np.linalg.pinv(fit.jac.T @ fit.jac)
    error = np.sqrt(np.maximum(np.diag(inverse), 0.0) * square / independent)
    clear = (
        math.hypot(*size) > SETTINGS.ringing_to_noise * math.sqrt(square / count)
        and error[0] < SETTINGS.frequency_error
        and lowest < frequency < _TOLD / spacing
        and frequency * t[-1] > SETTINGS.least_swings
        and decay < 2.0 * math.pi * frequency * SETTINGS.largest_damping
    )
    if not clear:
        return None
    return Ringing(frequency, decay, frequency * float(error[0]), decay * float(error[1]))


def fit_later_ringing(t: Array, x: Array, longest: float, order: int = 3) -> Ringing | None:
    """Fit as `fit_ringing` does, without the first swing, in which the contact may slide.

    The time after the ringing has died away is left out, too.
    """
    found = fit_ringing(t, x, longest, order)
    if found is None:
        return None
    gone = min(_GONE / max(found.decay, 1e-9), _SWINGS_LOOKED_AT * found.swing)
    later = (t > t[0] + found.swing) & (t < t[0] + found.swing + gone)
    if later.sum() < 2 * _FEWEST or np.ptp(t[later]) * found.frequency < _SWINGS_LATER:
        return found
    again = fit_ringing(t[later], x[later], longest, order)
    same = again is not None and abs(again.frequency / found.frequency - 1.0) < _SAME
    return again if same else found


def combine(in_cycle: Ringing | None, in_rest: Ringing | None, period: float) -> Ringing | None:
    """Return the better of the ringings seen in the mean cycle and in the rest after the last slip.

    Neither is told where they differ. period (s) is that of the drive.
    """
    found = [
        replace(
            one,
            frequency_error=math.hypot(one.frequency_error, bend * one.frequency),
            decay_error=math.hypot(
                one.decay_error, _BEND_OF_DECAY * one.decay, _DECAY_ERROR / period
            ),
        )
        for one, bend in ((in_cycle, _BEND_IN_CYCLE), (in_rest, _BEND_IN_REST))
        if one is not None
    ]
    best = min(found, key=lambda one: one.frequency_error, default=None)
    frequencies = [one.frequency for one in found]
    if best and max(frequencies) > (1.0 + _DISAGREE) * min(frequencies):
        return replace(best, frequency_error=math.inf)
    return best


def without_ringing(level: Level, ringing: Ringing, swings: float) -> Level:
    """Return the place towards which the runner rings, of positions smoothed over some swings.

    A slip is a step there. Three samples of a damped sinusoid, however far apart, have one relation
    (R. Prony, J. Ec. Polytech. 1 (1795) 24), and so have means of it.
    """
    x = smooth(level.x, swings * ringing.swing / level.spacing)
    before, after = (np.pad(x, 1, mode="edge")[k : len(x) + k] for k in (0, 2))
    fade = math.exp(-ringing.decay * level.spacing)
    turn = 2.0 * fade * math.cos(2.0 * math.pi * ringing.frequency * level.spacing)
    place = (after - turn * x + fade * fade * before) / (1.0 - turn + fade * fade)
    return replace(level, x=place)
