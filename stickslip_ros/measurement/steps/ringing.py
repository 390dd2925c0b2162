# SPDX-License-Identifier: Apache-2.0
"""The ringing of the contact after slips, fitted as a damped sinusoid."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import scipy  # its parts load when they are used, which takes half a second

from stickslip_ros.arrays import Array
from stickslip_ros.measurement.steps.record import Level, smooth
from stickslip_ros.measurement.steps.settings import SETTINGS

#: Samples of a fit at least; frequencies tried; decays tried, over the time that is fitted.
_FEWEST, _FREQUENCIES, _DECAYS = 12, 400, (1.0, 3.0, 8.0, 20.0)
#: Swings from which on the first one is left out; part by which the frequency is the same without.
#: Decays after which nothing of it is left.
_SWINGS_LATER, _SAME, _GONE = 6.0, 0.05, 6.0
#: Swings that are left out; part of the frequency by which it may be uncertain without so many.
_SKIPPED, _EXACT = (1.0, 2.0, 4.0), 3e-4
#: Part of the sampling rate up to which frequencies are tried, and told.
_TRIED, _TOLD = 0.4, 0.38


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


def fit_ringing(t: Array, x: Array, longest: float, order: int = 3) -> Ringing | None:
    """Fit a polynomial of an order and a damped sinusoid to x (m) at times t (s).

    longest (s) is the longest swing that is looked for. None where no ringing is clear.
    """
    if len(t) < _FEWEST:
        return None
    t = t - t[0]
    spacing = float(np.median(np.diff(t)))
    place = t / t[-1]
    base = np.polynomial.polynomial.polyfit(place, x, order, w=np.exp(-3.0 * place))
    rest = x - np.polynomial.polynomial.polyval(place, base)
    lowest, highest = max(1.5 / t[-1], 1.0 / longest), _TRIED / spacing
    if not lowest < highest:
        return None
    tried = np.geomspace(lowest, highest, _FREQUENCIES)
    waves = np.exp(-2j * math.pi * tried[:, None] * t)

    def left(log: Array) -> Array:
        columns = _columns(t, math.exp(log[0]), math.exp(log[1]), order)
        return np.asarray(x - columns @ np.linalg.lstsq(columns, x, rcond=None)[0])

    best = None
    for decay in np.array(_DECAYS) / t[-1]:
        weight = np.exp(-decay * t)
        power = np.abs(waves @ (weight * rest)) / math.sqrt(float(weight @ weight))
        start = [math.log(float(tried[int(np.argmax(power))])), math.log(decay)]
        try:
            found = scipy.optimize.least_squares(left, start, x_scale=[0.01, 0.3], max_nfev=40)
        except (ValueError, OverflowError, np.linalg.LinAlgError):
            continue
        if best is None or found.cost < best.cost:
            best = found
    return None if best is None else _checked(t, x, best, order, tried[0], _TOLD / spacing)


def fit_later_ringing(t: Array, x: Array, longest: float, order: int = 3) -> Ringing | None:
    """Fit as `fit_ringing` does, without the first swings, in which the contact may slide.

    The time after the ringing has died away is left out, too.
    """
    found = fit_ringing(t, x, longest, order)
    if found is None:
        return None
    for skipped in _SKIPPED:
        begin = t[0] + skipped * found.swing
        later = (t > begin) & (t < begin + _GONE / max(found.decay, 1e-9))
        if later.sum() < 2 * _FEWEST or np.ptp(t[later]) * found.frequency < _SWINGS_LATER:
            break
        again = fit_ringing(t[later], x[later], longest, order)
        if again is None or abs(again.frequency / found.frequency - 1.0) > _SAME:
            break
        if skipped > 1.0 and again.frequency_error > _EXACT * again.frequency:
            break
        found = again
    return found


def _columns(t: Array, frequency: float, decay: float, order: int) -> Array:
    place = t / max(t[-1], 1e-30)
    waves = Ringing(frequency, decay).columns(t)
    return np.column_stack([*(place**k for k in range(order + 1)), waves])


def _checked(
    t: Array,
    x: Array,
    fit: scipy.optimize.OptimizeResult,
    order: int,
    lowest: float,
    highest: float,
) -> Ringing | None:
    """Return the ringing of a fit with its errors; None where it may be chance."""
    frequency, decay = math.exp(min(fit.x[0], 60.0)), math.exp(min(fit.x[1], 60.0))
    left = fit.fun
    scale = float(left @ left)
    like = float(left[1:] @ left[:-1]) / scale if scale > 0.0 else 0.0
    like = min(max(like, 0.0), 0.95)
    independent = max(len(t) * (1.0 - like) / (1.0 + like) - order - 5.0, 1.0)
    try:
        covariance = scale / independent * np.linalg.inv(fit.jac.T @ fit.jac)
    except np.linalg.LinAlgError:
        return None
    error = np.sqrt(np.abs(np.diag(covariance)))
    columns = _columns(t, frequency, decay, order)
    size = math.hypot(*np.linalg.lstsq(columns, x, rcond=None)[0][-2:])
    clear = (
        size > SETTINGS.least_ringing_to_noise * math.sqrt(scale / len(t))
        and error[0] < SETTINGS.largest_frequency_error
        and lowest < frequency < highest
        and frequency * t[-1] > SETTINGS.least_swings
        and decay < 2.0 * math.pi * frequency * SETTINGS.largest_damping
    )
    if not clear:
        return None
    return Ringing(frequency, decay, frequency * float(error[0]), decay * float(error[1]))


def combine(
    in_cycle: Ringing | None,
    in_rest: Ringing | None,
    looked_at: tuple[float, float],
    period: float,
) -> Ringing | None:
    """Return the better of the ringings seen in the mean cycle and in the rest after the last slip.

    Neither is told where they differ, or where only one shows it although the other is long enough
    (looked_at: time that was seen of both, s; 0: too few samples). period (s) is that of the drive.
    """
    found = [
        replace(
            one,
            frequency_error=math.hypot(one.frequency_error, bend * one.frequency),
            decay_error=math.hypot(
                one.decay_error,
                SETTINGS.bend_of_decay * one.decay,
                SETTINGS.decay_error_periods / period,
            ),
        )
        for one, bend in ((in_cycle, SETTINGS.bend_in_cycle), (in_rest, SETTINGS.bend_in_rest))
        if one is not None
    ]
    if not found:
        return None
    best = min(found, key=lambda one: one.frequency_error)
    if len(found) == 2:
        apart = abs(found[0].frequency / found[1].frequency - 1.0)
        doubtful = apart > SETTINGS.largest_disagreement
    else:
        other = looked_at[0] if in_cycle is None else looked_at[1]
        doubtful = other * best.frequency > SETTINGS.least_swings_in_cycle
    return replace(best, frequency_error=math.inf) if doubtful else best


def without_ringing(level: Level, ringing: Ringing, swings: float) -> Level:
    """Return the place towards which the runner rings, x + 2 d x' / w^2 + x'' / w^2.

    A slip is a step there, so many swings wide.
    """
    width = swings * ringing.swing / level.spacing
    square = (2.0 * math.pi * ringing.frequency * level.spacing) ** 2
    place, speed, bend = (smooth(level.x, width, order) for order in range(3))
    return replace(level, x=place + (2.0 * ringing.decay * level.spacing * speed + bend) / square)
