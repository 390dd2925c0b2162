# SPDX-License-Identifier: Apache-2.0
"""The cycles of a trace: when each begins and when its slip begins, by the actuator or by a clock.

A cycle ends with the slip of the actuator. If the actuator was measured, its fast strokes are the
slips. If only the runner was,
the slips are found by their likeness (:mod:`matching`).
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import scipy  # its parts load when they are used, which takes half a second

from stickslip_ros.base.arrays import Array
from stickslip_ros.measurement.steps.record import FASTER, TraceError
from stickslip_ros.measurement.steps.run import Cycles
from stickslip_ros.measurement.steps.settings import SETTINGS

#: Part of a period by which a trace may be short of a whole cycle at its ends, and by which a
#: frequency that is given may be off: clocks agree far better, single samples do not.
SHORT = 0.01
#: Parts of the deflection that a stroke goes through; parts between which all of it lies, of many
#: samples: a few may be spikes.
_LEVELS, _OUTER, _MANY = (0.25, 0.75), (0.001, 0.999), 10_000
#: Shares of the deflection within which a sample lies in a slip; such samples, and the range of
#: their shares, that show its slope.
_WITHIN, _FEW_WITHIN, _SPREAD = (0.05, 0.95), 4, 0.2
#: A rest between runs lasts so many times the time between the strokes beside it, or more.
_RESTS = 3.0
#: Part of its range within which a runner gets nowhere.
_NOWHERE = 1e-2


def cycles_of_clock(t: Array, x: Array, period: float, start: float) -> Cycles:
    """Return the whole cycles of a period (s) from the start (s) of the first one on.

    t (s) and x (m) are the trace. Raises TraceError if it holds none.
    """
    count = np.floor((t[-1] - start) / period + SHORT)
    slips = start + period * np.arange(1.0, count + 1.0)
    return _at_least_one(Cycles.even(slips, period, direction_of(t, x)))


def _at_least_one(cycles: Cycles) -> Cycles:
    if not len(cycles.slips):
        raise TraceError(
            f"the trace has no whole cycle of {cycles.period:g} s; record a longer one, or check "
            "frequency and start"
        )
    return cycles


def cycles_of_actuator(
    t: Array, u: Array, frequency: float | None = None, start: float | None = None
) -> Cycles:
    """Return the whole cycles of an actuator that moves: times t (s), deflection u (m).

    Slips are the shorter ones of the strokes between a quarter and three of the deflection.
    frequency (Hz) and start of the first cycle (s) are taken as they are where given. Raises
    TraceError.
    """
    share = _share_of(u)
    strokes = find_strokes(t, share)
    falls, rises = strokes[strokes[:, 2] < 0], strokes[strokes[:, 2] > 0]
    if len(falls) + len(rises) < 2:
        raise TraceError(
            f"the actuator makes no whole cycle in the trace; record a longer one, or {too_slow(t)}"
        )
    length = [np.median(s[:, 1] - s[:, 0]) if len(s) else np.inf for s in (falls, rises)]
    direction = 1 if length[0] <= length[1] else -1
    slip, slow = (falls, rises) if direction > 0 else (rises, falls)
    spacing = float(np.median(np.diff(t)))
    slip, apart = find_even(slip[:, :2], 2.0 * spacing)
    even = len(slip) > 2 and float(np.ptp(np.diff(slip[:, 0]))) < 1e-3 * spacing
    at = np.clip(np.searchsorted(t, slip.mean(axis=1)), 1, len(t) - 1)
    usual = np.abs((t[at] - t[at - 1]) / spacing - 1.0).max() < SHORT  # no kinks of a simulation
    short = usual and (slip[:, 1] - slip[:, 0]).max() < 2.0 * spacing
    if even and short and len(slow) > 2:
        apart = find_even(slow[:, :2], 2.0 * spacing)[1]
        slip = _sharpened(t, share, slip, apart, spacing)
    half = 0.5 * (slip[:, 1] - slip[:, 0])
    slips, ends = slip[:, 0] - half, slip[:, 1] + half
    if frequency is not None:
        period = 1.0 / frequency
        if abs(apart - period) > SHORT * period:
            raise TraceError(
                f"the slips are {apart:g} s apart, a frequency of {frequency:g} Hz would make that "
                f"{period:g} s; correct the frequency or leave it out"
            )
    elif len(slips) > 1:
        period = apart
    elif start is not None:
        period = float(ends[0] - start)
    else:
        raise TraceError(
            "the trace has only one slip and so no period; give the drive frequency, or "
            f"{too_slow(t)}"
        )
    first = start if start is not None else float(ends[0] - period)
    kept = ends > first + 0.5 * period
    slips, ends = slips[kept], np.minimum(ends[kept], t[-1])
    starts = np.concatenate(([max(first, t[0])], ends[:-1]))
    if first < t[0] - SHORT * period:  # the first cycle began before the trace
        starts, slips, ends = starts[1:], slips[1:], ends[1:]
    return _at_least_one(Cycles(period, direction, starts, slips, ends))


def _sharpened(t: Array, share: Array, slip: Array, period: float, spacing: float) -> Array:
    """Return slips (begin, end), s, that take less time than the samples are apart (s).

    Straight lines between samples make each of them last as long as that. The samples of all slips
    together, which lie at other places of each, show the line that the deflection falls along. The
    period (s) is that of the slow strokes, which samples show well.
    """
    turns = period * np.arange(float(len(slip)))
    middle = float(np.mean(slip.mean(axis=1) - turns)) + turns
    number = np.clip(np.searchsorted(t, middle)[:, None] + np.arange(-2, 2), 0, len(t) - 1)
    since, shares = t[number] - middle[:, None], share[number]
    half = 1e-3 * spacing  # none of them fell into a slip
    within = (shares > _WITHIN[0]) & (shares < _WITHIN[1]) & (np.abs(since) < spacing)
    if within.sum() >= _FEW_WITHIN and np.ptp(shares[within]) > _SPREAD:
        slope, late = np.polyfit(shares[within] - 0.5, since[within], 1)
        middle, half = middle + float(late), 0.25 * abs(float(slope))
    return np.column_stack([middle - half, middle + half])


def stretches_of_actuator(t: Array, u: Array) -> list[slice]:
    """Return the parts of a record, times t (s), with cycles of the actuator u (m) between rests.

    A rest is far longer than the time from stroke to stroke on either side.
    """
    strokes = find_strokes(t, _share_of(u))
    if len(strokes) < 2:
        return [slice(0, len(t))]
    gaps = np.diff(strokes[:, :2].mean(axis=1))
    usual = np.maximum(np.append(gaps[1:], 0.0), np.append(0.0, gaps[:-1]))
    rests = np.flatnonzero(gaps > _RESTS * usual) if len(gaps) > 2 else np.array([], dtype=int)
    middles = 0.5 * (strokes[rests, 1] + strokes[rests + 1, 0])
    edges = [0, *np.searchsorted(t, middles).tolist(), len(t)]
    return [slice(*edge) for edge in pairwise(edges)]


def _share_of(u: Array) -> Array:
    """Return a deflection (m) as share of its range; a few samples may be spikes."""
    low, high = np.quantile(u, _OUTER) if len(u) > _MANY else np.array([u.min(), u.max()])
    return np.asarray((u - low) / (high - low))


def too_slow(t: Array) -> str:
    """Return what helps if the drive is too fast for the samples at times t (s)."""
    rate = 1.0 / float(np.median(np.diff(t)))
    return (
        f"if the drive is faster than {rate / SETTINGS.least_samples_a_cycle:.3g} Hz, {FASTER}: "
        f"{rate:.4g} samples a second are too few for it"
    )


def find_even(slip: Array, resolution: float) -> tuple[Array, float]:
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


def find_strokes(t: Array, share: Array) -> Array:
    """Return rows (begin, end, sign) of the strokes of a share of the deflection through 1/4, 3/4.

    Noise that crosses one of the two levels back and forth makes no stroke.
    """
    times, levels = [], []
    for level in _LEVELS:
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


def direction_of(t: Array, x: Array) -> int:
    """Return the way the runner goes; where it gets nowhere, against its fastest moves."""
    way = x[-1] - x[0]
    speed = np.diff(x) / np.diff(t)
    if abs(way) < _NOWHERE * np.ptp(x):
        way = -np.sum((speed - np.mean(speed)) ** 3)
    return -1 if way < 0.0 else 1
