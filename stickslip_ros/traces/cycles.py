# SPDX-License-Identifier: Apache-2.0
"""The cycles of a trace: when each begins and when its slip begins, given or found.

A cycle ends with the slip of the actuator. If the actuator was measured, its fast strokes are the
slips. If only the runner was, the period is the delay after which the motion repeats itself, apart
from one step, and the slips are where the smooth motion breaks off.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy  # its parts load when they are used, which takes half a second
from numpy.typing import NDArray

from stickslip_ros.errors import StickslipError
from stickslip_ros.traces.ringing import Ringing, fit_ringing

Array = NDArray[np.float64]

#: Fewest cycles in which a period is looked for.
FEWEST = 3
#: Samples on an even grid for the search of the period, and for the mean cycle.
_GRID, _FOLDS = 2**19, 2000
#: Fewest samples of a cycle in the search of the period.
_COARSEST = 8
#: A delay repeats the motion if what differs is below this part of the usual difference.
_REPEATS = 0.1
#: A motion is straight if its usual difference is below this part of its square.
_STRAIGHT = 1e-12
#: Part of a period by which a trace may be short of a whole cycle at its ends.
_SHORT = 0.01
#: Cycles in the mean cycle: so few that a period found on the grid does not smear it.
_MEAN = 200
#: Slips looked at one by one; what is looked at around each, part of a period, samples at least.
_ALIGNED, _AROUND, _SAMPLES_AROUND = 200, 0.05, 10
#: The line through slips is followed outwards from the middle, so many times as far each time.
_FURTHER = 4


class TraceError(StickslipError, ValueError):
    """A trace that cannot be analysed; the message says what is missing."""


@dataclass(frozen=True)
class Cycles:
    """Whole cycles of a trace, each array of shape (cycles,)."""

    period: float  #: s
    direction: int  #: of the steps, +1 or -1
    starts: Array  #: begin of each cycle, s
    slips: Array  #: begin of the slip of each cycle, s
    ends: Array  #: end of the slip and of the cycle, s; the begin of the slip where that is unknown


def find_cycles(
    t: Array, x: Array, u: Array | None, frequency: float | None, start: float | None
) -> Cycles:
    """Return the whole cycles of a trace: times t (s), runner x (m) and actuator u (m) if known.

    frequency (Hz) and start of the first cycle (s) are taken as they are where given.
    Raises TraceError.
    """
    if u is not None and np.ptp(u) > 0.0:
        return _of_actuator(t, u, frequency, start)
    direction = _direction_of(t, x)
    period = 1.0 / frequency if frequency is not None else _period_of(t, direction * x)
    if start is None:
        slip, found = _slip_of(t, direction * x, period)
        period = period if frequency is not None else found
        short = max(_SHORT * period, 2.0 * float(np.median(np.diff(t))))
        count = np.floor((t[-1] - slip + short) / period)
        slips = slip + period * np.arange(count + 1)
    else:
        count = np.floor((t[-1] - start) / period + _SHORT)
        slips = start + period * np.arange(1, count + 1)
    if start is None and slips[0] - period < t[0] - _SHORT * period:
        slips, starts = slips[1:], slips[:-1]
    else:
        starts = (
            np.concatenate(([max(slips[0] - period, t[0])], slips[:-1])) if len(slips) else slips
        )
    return _checked(Cycles(period, direction, starts, slips, slips))


def _checked(cycles: Cycles) -> Cycles:
    if not len(cycles.slips):
        raise TraceError(
            f"the trace has no whole cycle of {cycles.period:g} s; record a longer one, or check "
            "frequency and start"
        )
    return cycles


def _of_actuator(t: Array, u: Array, frequency: float | None, start: float | None) -> Cycles:
    """Slips are the shorter ones of the strokes between a quarter and three of the deflection."""
    low, high = np.quantile(u, [0.001, 0.999]) if len(u) > 10_000 else np.array([u.min(), u.max()])
    strokes = _strokes(t, (u - low) / (high - low))
    falls, rises = strokes[strokes[:, 2] < 0], strokes[strokes[:, 2] > 0]
    if len(falls) + len(rises) < 2:
        raise TraceError("the actuator makes no whole cycle in the trace; record a longer one")
    length = [np.median(s[:, 1] - s[:, 0]) if len(s) else np.inf for s in (falls, rises)]
    direction = 1 if length[0] <= length[1] else -1
    slip = falls if direction > 0 else rises
    slip, apart = _even(slip[:, :2], 2.0 * float(np.median(np.diff(t))))
    half = 0.5 * (slip[:, 1] - slip[:, 0])
    slips, ends = slip[:, 0] - half, slip[:, 1] + half
    if frequency is not None:
        period = 1.0 / frequency
        if abs(apart - period) > _SHORT * period:
            raise TraceError(
                f"the slips are {apart:g} s apart, a frequency of {frequency:g} Hz would make that "
                f"{period:g} s; correct the frequency or leave it out"
            )
    elif len(slips) > 1:
        period = apart
    elif start is not None:
        period = float(ends[0] - start)
    else:
        raise TraceError("the trace has only one slip and so no period; give the drive frequency")
    first = start if start is not None else float(ends[0] - period)
    kept = ends > first + 0.5 * period
    slips, ends = slips[kept], np.minimum(ends[kept], t[-1])
    starts = np.concatenate(([max(first, t[0])], ends[:-1]))
    if first < t[0] - _SHORT * period:  # the first cycle began before the trace
        starts, slips, ends = starts[1:], slips[1:], ends[1:]
    return _checked(Cycles(period, direction, starts, slips, ends))


def _even(slip: Array, resolution: float) -> tuple[Array, float]:
    """Return slips (begin, end) and the time between them, s; nan for one slip alone.

    Slips that are equally far apart but for the resolution of the samples (s) are made so.
    """
    if len(slip) < 2:
        return slip, np.nan
    middle, number = slip.mean(axis=1), np.arange(float(len(slip)))
    apart, first, *_ = scipy.stats.theilslopes(middle, number)
    line = first + apart * number
    if np.abs(middle - line).max() > resolution:
        return slip, float(np.median(np.diff(middle)))
    half = 0.5 * float(np.median(slip[:, 1] - slip[:, 0]))
    return np.column_stack([line - half, line + half]), float(apart)


def _strokes(t: Array, share: Array) -> Array:
    """Return rows (begin, end, sign) of the strokes of a share of the deflection through 1/4, 3/4.

    Noise that crosses one of the two levels to and fro makes no stroke.
    """
    times, levels = [], []
    for level in (0.25, 0.75):
        above = share >= level
        at = np.flatnonzero(above[1:] != above[:-1])
        part = (level - share[at]) / (share[at + 1] - share[at])
        times.append(t[at] + part * (t[at + 1] - t[at]))
        levels.append(np.full(len(at), level))
    order = np.argsort(np.concatenate(times), kind="stable")
    time, passed = np.concatenate(times)[order], np.concatenate(levels)[order]
    through = np.flatnonzero(passed[1:] != passed[:-1])
    sign = np.sign(passed[through + 1] - passed[through])
    return np.column_stack([time[through], time[through + 1], sign])


def _direction_of(t: Array, x: Array) -> int:
    """Return the way the runner goes; where it gets nowhere, against its fastest moves."""
    way = x[-1] - x[0]
    speed = np.diff(x) / np.diff(t)
    if abs(way) < 1e-2 * np.ptp(x):
        way = -np.sum((speed - np.mean(speed)) ** 3)
    return -1 if way < 0.0 else 1


def _period_of(t: Array, x: Array) -> float:
    """Return the shortest delay after which the motion repeats itself but for a constant, s."""
    moving = (x >= x.min() + 0.02 * np.ptp(x)) & (x <= x.max() - 0.02 * np.ptp(x))
    inside = np.flatnonzero(moving)
    if len(inside) < 16:
        raise TraceError("the trace shows no steps to find the period from; give the frequency")
    t, x = t[inside[0] : inside[-1] + 1], x[inside[0] : inside[-1] + 1]
    count = max(256, 1 + round((t[-1] - t[0]) / np.median(np.diff(t))))
    if count <= _GRID:
        return _repeated_after(*_even_grid(t, x, count))
    # Too long to be looked at in full. As a whole it shows a long period, but blurs a short one.
    part = slice((len(t) - _GRID) // 2, (len(t) + _GRID) // 2)
    try:
        long = _repeated_after(*_averaged(t, x, _GRID))
        if FEWEST * long > t[part][-1] - t[part][0]:
            return long
    except TraceError:
        pass
    return _repeated_after(*_even_grid(t[part], x[part], _GRID))


def _even_grid(t: Array, x: Array, count: int) -> tuple[Array, float]:
    """Return that many samples, evenly apart, and the time between them, s."""
    grid = np.linspace(t[0], t[-1], count)
    return np.interp(grid, t, x), float((t[-1] - t[0]) / (count - 1))


def _averaged(t: Array, x: Array, count: int) -> tuple[Array, float]:
    """Return that many means over equal spans, and how long these are, s; nothing is aliased."""
    about = x - x.mean()
    area = np.concatenate(([0.0], np.cumsum(0.5 * (about[1:] + about[:-1]) * np.diff(t))))
    span = float((t[-1] - t[0]) / count)
    return np.diff(np.interp(np.linspace(t[0], t[-1], count + 1), t, area)) / span, span


def _repeated_after(even: Array, interval: float) -> float:
    """Return the shortest delay (s) after which samples repeat but for a constant."""
    count = len(even)
    differing = _difference_after(even - even.mean(), count // 2)
    usual = float(np.median(differing[count // 20 :]))
    minima = (
        np.flatnonzero((differing[1:-1] <= differing[:-2]) & (differing[1:-1] < differing[2:])) + 1
    )
    minima = minima[minima >= _COARSEST]
    least = float(differing[minima].min()) if len(minima) else np.inf
    if least > 0.7 * usual or usual < _STRAIGHT * np.ptp(even) ** 2:
        raise TraceError("the trace repeats nowhere; give the drive frequency")
    same = least + _REPEATS * (usual - least)
    for candidate in minima[differing[minima] <= same]:
        delay = _repeating(differing, int(candidate), same)
        if delay is not None:
            return delay * interval
    raise TraceError("the trace repeats nowhere; give the drive frequency")


def _repeating(differing: Array, candidate: int, same: float) -> float | None:
    """Return the delay (in samples) from its multiples; None if the motion repeats at no multiple.

    Ringing repeats after its own period, but not after many.
    """
    near = slice(candidate, int(1.1 * candidate) + 1)
    delay, times = float(near.start + np.argmin(differing[near])), 1
    while True:
        times = max(times + 1, int(1.4 * times))
        reach = max(1.0, 0.05 * delay)
        low, high = int(times * delay - reach), int(times * delay + reach) + 2
        if high > len(differing):
            return delay
        at = low + int(np.argmin(differing[low:high]))
        if differing[at] > same:
            return None
        delay = at / times


def _difference_after(x: Array, longest: int) -> Array:
    """Return the variance of x(k + n) - x(k) for each delay n up to the longest."""
    count = len(x)
    spectrum = np.fft.rfft(x, 2 * count)
    products = np.fft.irfft(np.abs(spectrum) ** 2)[: longest + 1]
    overlap = count - np.arange(longest + 1)
    sums, squares = np.concatenate(([0.0], np.cumsum(x))), np.concatenate(([0.0], np.cumsum(x * x)))
    delay = np.arange(longest + 1)
    head, tail = sums[count - delay], sums[count] - sums[delay]
    square = squares[count - delay] + squares[count] - squares[delay] - 2.0 * products
    return square / overlap - ((tail - head) / overlap) ** 2  # type: ignore[no-any-return]


def _slip_of(t: Array, x: Array, period: float) -> tuple[float, float]:
    """Return when the first slip of a trace in forward steps begins (s), and the period (s).

    In the mean cycle, the slip is where two runs meet that are smooth but for the ringing.
    """
    mean = _mean_cycle(t, x, period)
    count = len(mean)
    width = max(2, count // 50)
    kernel = np.concatenate([np.full(width, 1.0), np.full(width, -1.0)]) / width
    drop = np.array([kernel @ np.take(mean, np.arange(k - width, k + width), mode="wrap")
                     for k in range(count)])  # fmt: skip
    coarse = int(np.argmax(drop))
    tick = period / count
    after = np.take(mean, np.arange(coarse, coarse + count), mode="wrap")
    times: Array = tick * np.arange(count, dtype=np.float64)
    ringing = fit_ringing([(times, after)])
    reach = width if ringing is None else max(width, int(1.0 / (ringing.frequency * tick)))
    reach = min(reach, count // 4)
    trials = np.arange(coarse - reach, coarse + reach // 2 + 1)
    rough = [_roughness(np.take(mean, np.arange(k, k + count), mode="wrap"), times, ringing)
             for k in trials]  # fmt: skip
    phase = (trials[int(np.argmin(rough))] % count) * tick
    middle = phase + period * round((0.5 * (t[0] + t[-1]) - phase) / period)
    slip, period = _followed(t, x, float(middle), period, ringing)
    return slip + period * math.ceil((t[0] - slip) / period - _SHORT), period


def _followed(
    t: Array, x: Array, slip: float, period: float, ringing: Ringing | None
) -> tuple[float, float]:
    """Return slip (s) and period (s) as found from the single slips before and after it.

    An error of the period grows from cycle to cycle, so the slips nearby come first: the line
    through them says where to look for those further off.
    """
    before, after = int((slip - t[0]) / period), int((t[-1] - slip) / period)
    around = _AROUND * period if ringing is None else 1.5 / ringing.frequency
    spacing = float(np.median(np.diff(t)))
    around = min(max(around, _SAMPLES_AROUND * spacing), 0.45 * period)
    reach = _MEAN // 2
    while True:
        first, last = -min(before, reach), min(after, reach)
        numbers, times = [], []
        for k in np.unique(np.linspace(first, last, _ALIGNED).astype(int)):
            found = _break_near(t, x, slip + k * period, around, ringing)
            if found is not None:
                numbers.append(float(k))
                times.append(found)
        if len(times) < 2:
            return slip, period
        each, begin, *_ = scipy.stats.theilslopes(times, numbers)  # a slip or two may be misjudged
        slip, period = float(begin), float(each)
        if reach >= max(before, after):
            return slip, period
        reach *= _FURTHER


def _break_near(
    t: Array, x: Array, slip: float, around: float, ringing: Ringing | None
) -> float | None:
    """Return when, near to a slip, one smooth run ends and the next begins, s."""
    low, at, high = np.searchsorted(t, [slip - around, slip, slip + around])
    if at - low < 8 or high - at < 8 or high - low > 20_000:
        return None
    reach = max(2, min(at - low, high - at) // 3)
    trials = np.unique(
        np.linspace(max(low + 5, at - reach), min(high - 6, at + reach), 60).astype(int)
    )
    rough = [
        _roughness(x[low:k], t[low:k] - t[low], ringing, 1)
        + _roughness(x[k:high], t[k:high] - t[k], ringing, 1)
        for k in trials
    ]
    best = trials[int(np.argmin(rough))]
    return float(0.5 * (t[best - 1] + t[best]))


def _mean_cycle(t: Array, x: Array, period: float) -> Array:
    """Return the mean positions (m) of one cycle in the middle, the trend left out; it closes."""
    cycles = math.floor((t[-1] - t[0]) / period)
    if cycles < 1:
        raise TraceError(
            f"the trace of {t[-1] - t[0]:g} s holds no whole cycle at {1.0 / period:g} Hz; "
            "correct the frequency or record a longer one"
        )
    end = t[-1] - max(0, cycles - _MEAN) // 2 * period
    begin = end - min(cycles, _MEAN) * period
    keep = slice(*np.searchsorted(t, [begin, np.nextafter(end, np.inf)]))
    t, x = t[keep], x[keep]
    trend = np.polynomial.Polynomial.fit(t, x, 1)
    x = x - trend(t)
    count = int(np.clip(np.median(np.round(period / np.diff(t))), 16, _FOLDS))
    place = np.floor((t % period) / period * count).astype(int) % count
    number = np.bincount(place, minlength=count)
    total = np.bincount(place, weights=x, minlength=count)
    phase = (np.arange(count) + 0.5) * period / count
    filled = number > 0
    return np.interp(phase, phase[filled], total[filled] / number[filled], period=period)


def _roughness(x: Array, t: Array, ringing: Ringing | None, degree: int = 2) -> float:
    """Return the sum of squares that a trend of that degree, with ringing, leaves of x."""
    design = [(t / t[-1]) ** power for power in range(degree + 1)]
    if ringing is not None:
        design.extend(ringing.columns(t).T)
    basis, _ = np.linalg.qr(np.column_stack(design))
    return float(np.sum((x - basis @ (basis.T @ x)) ** 2))
