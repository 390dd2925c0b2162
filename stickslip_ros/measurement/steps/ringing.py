# SPDX-License-Identifier: Apache-2.0
"""The ringing of the contact after slips, fitted as a damped sinusoid."""

from __future__ import annotations

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
#: Swings from which on the first one is left out; part by which the frequency is the same without.
#: Decays after which nothing of it is left.
_SWINGS_LATER, _SAME, _GONE = 6.0, 0.05, 6.0
#: Swings that are left out; part of the frequency by which it may be uncertain without so many.
_SKIPPED, _EXACT = (1.0, 2.0, 4.0), 3e-4
#: Part of the sampling rate up to which frequencies are tried, and told.
_TRIED, _TOLD = 0.4, 0.38
#: Parts by which a contact rings off its linear frequency in a rest and in a cycle, and by which
#: both may differ; by which sliding makes swings die away otherwise; error of a decay times period.
_BEND_IN_REST, _BEND_IN_CYCLE, _DISAGREE = 0.0005, 0.001, 0.02
_BEND_OF_DECAY, _DECAY_ERROR = 0.02, 0.05
#: Swings from which on a cycle shows the ringing by itself; of the rest that are looked at.
SWINGS_IN_CYCLE, _SWINGS_LOOKED_AT = 8.0, 30.0


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
    scale = float(np.std(rest)) or 1.0  # the solver's tolerances are absolute
    lowest, highest = max(1.5 / t[-1], 1.0 / longest), _TRIED / spacing
    if not lowest < highest:
        return None
    even = np.linspace(0.0, t[-1], len(t))
    spread = np.interp(even, t, rest)
    tried = np.fft.rfftfreq(_FINER * len(t), even[1])
    inside = np.flatnonzero((tried >= lowest) & (tried <= highest))
    if not len(inside):
        return None
    model = _DampedWave(t, x, order, scale)
    best = None
    for decay in np.array(_DECAYS) / t[-1]:
        weight = np.exp(-decay * even)
        power = np.abs(np.fft.rfft(weight * spread, _FINER * len(t)))[inside]
        start = [math.log(float(tried[inside[int(np.argmax(power))]])), math.log(decay)]
        try:
            found = scipy.optimize.least_squares(
                model.left, start, x_scale=[0.01, 0.3], max_nfev=40
            )
        except (ValueError, OverflowError, np.linalg.LinAlgError):
            continue
        if best is None or found.cost < best.cost:
            best = found
    return None if best is None else _checked(model, best, (lowest, _TOLD / spacing))


class _DampedWave:
    """Positions over time as a polynomial and a damped sinusoid, whose sizes are always the best.

    They are projected out (variable projection, Golub and Pereyra, SIAM J. Numer. Anal. 10 (1973)
    413), so that frequency and decay are left. Times t (s) begin at 0; residuals are parts of a
    scale (m), as the tolerances of the solver are absolute.
    """

    def __init__(self, t: Array, x: Array, order: int, scale: float) -> None:
        self.t, self.scale, self.order = t, scale, order
        powers = np.polynomial.polynomial.polyvander(t / max(float(t[-1]), 1e-30), order)
        self._base = np.linalg.qr(powers)[0]
        self._x = self._beside(x[:, None] / scale)[:, 0]

    def _beside(self, columns: Array) -> Array:
        return np.asarray(columns - self._base @ (self._base.T @ columns))

    def _columns(self, log: Array) -> Array:
        frequency, decay = (math.exp(one) for one in log)
        return self._beside(Ringing(frequency, decay).columns(self.t))

    def size(self, log: Array) -> float:
        """Return the amplitude at time 0, over the scale, of a log frequency (Hz) and decay."""
        columns = self._columns(log)
        return math.hypot(*np.linalg.lstsq(columns, self._x, rcond=None)[0])

    def left(self, log: Array) -> Array:
        """Return the residuals, (samples,), of the logarithms of a frequency (Hz) and a decay."""
        columns = self._columns(log)
        square = columns.T @ columns
        square[0, 0], square[1, 1] = square[0, 0] + 1e-300, square[1, 1] + 1e-300
        return np.asarray(self._x - columns @ np.linalg.solve(square, columns.T @ self._x))


def fit_later_ringing(t: Array, x: Array, longest: float, order: int = 3) -> Ringing | None:
    """Fit as `fit_ringing` does, without the first swings, in which the contact may slide.

    The time after the ringing has died away is left out, too.
    """
    found = fit_ringing(t, x, longest, order)
    if found is None:
        return None
    for skipped in _SKIPPED:
        begin = t[0] + skipped * found.swing
        gone = min(_GONE / max(found.decay, 1e-9), _SWINGS_LOOKED_AT * found.swing)
        later = (t > begin) & (t < begin + gone)
        if later.sum() < 2 * _FEWEST or np.ptp(t[later]) * found.frequency < _SWINGS_LATER:
            break
        again = fit_ringing(t[later], x[later], longest, order)
        if again is None or abs(again.frequency / found.frequency - 1.0) > _SAME:
            break
        if skipped > 1.0 and again.frequency_error > _EXACT * again.frequency:
            break
        found = again
    return found


def _checked(
    model: _DampedWave, fit: scipy.optimize.OptimizeResult, limits: tuple[float, float]
) -> Ringing | None:
    """Return the ringing of a fit with its errors; None where it may be chance."""
    frequency, decay = math.exp(min(fit.x[0], 60.0)), math.exp(min(fit.x[1], 60.0))
    left, count = fit.fun, len(fit.fun)
    square = float(left @ left)
    like = float(left[1:] @ left[:-1]) / square if square > 0.0 else 0.0
    like = min(max(like, 0.0), 0.95)
    independent = max(count * (1.0 - like) / (1.0 + like) - model.order - 5.0, 1.0)
    try:
        covariance = square / independent * np.linalg.inv(fit.jac.T @ fit.jac)
        size = model.size(fit.x)
    except np.linalg.LinAlgError:
        return None
    error = np.sqrt(np.abs(np.diag(covariance)))
    clear = (
        size > SETTINGS.ringing_to_noise * math.sqrt(square / count)
        and error[0] < SETTINGS.frequency_error
        and limits[0] < frequency < limits[1]
        and frequency * model.t[-1] > SETTINGS.least_swings
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
                _BEND_OF_DECAY * one.decay,
                _DECAY_ERROR / period,
            ),
        )
        for one, bend in ((in_cycle, _BEND_IN_CYCLE), (in_rest, _BEND_IN_REST))
        if one is not None
    ]
    if not found:
        return None
    best = min(found, key=lambda one: one.frequency_error)
    if len(found) == 2:
        apart = abs(found[0].frequency / found[1].frequency - 1.0)
        doubtful = apart > _DISAGREE
    else:
        other = looked_at[0] if in_cycle is None else looked_at[1]
        doubtful = other * best.frequency > SWINGS_IN_CYCLE
    return replace(best, frequency_error=math.inf) if doubtful else best


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
