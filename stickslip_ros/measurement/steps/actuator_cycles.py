# SPDX-License-Identifier: Apache-2.0
"""The cycles of a drive by its deflection or its voltage.

A cycle ends with the slip of the actuator: the shorter ones of the strokes between a quarter and
three of the signal.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import scipy  # its parts load when they are used, which takes half a second

from stickslip_ros.base.arrays import Array
from stickslip_ros.measurement.steps.record import TraceError
from stickslip_ros.measurement.steps.run import Cycles
from stickslip_ros.simulation.settled import settled_mean

#: Part of a period by which a signal may be short of a whole cycle at its begin.
_SHORT = 0.01
#: Parts of the signal that a stroke goes through; parts between which all of it lies, of many
#: samples: a few may be spikes.
_LEVELS, _OUTER, _MANY = (0.25, 0.75), (0.001, 0.999), 10_000
#: A rest between runs lasts so many times the time between the strokes beside it, or more.
_RESTS = 3.0


def runs_of_signal(t: Array, u: Array) -> list[Cycles]:
    """Return the whole cycles of each run in a signal that moves: times t (s), deflection u (m).

    Slips that are equally far apart but for the resolution of the samples are made so. A rest is
    far longer than the time from stroke to stroke on either side. None where it stands still.
    Raises TraceError for a sample that is no number.
    """
    bad = np.flatnonzero(~np.isfinite(u))
    if len(bad):
        raise TraceError(f"actuator sample {bad[0]} is {u[bad[0]]}; leave such samples out")
    if not len(u) or not np.ptp(u) > 0.0:
        return []
    strokes = find_strokes(t, _share_of(u))
    gaps = np.diff(strokes[:, :2].mean(axis=1))
    usual = np.maximum(np.append(gaps[1:], 0.0), np.append(0.0, gaps[:-1])) if len(gaps) else gaps
    rests = np.flatnonzero(gaps > _RESTS * usual) if len(gaps) > 2 else np.array([], dtype=int)
    edges = [0, *(rests + 1).tolist(), len(strokes)]
    limits = [t[0], *(0.5 * (strokes[rests, 1] + strokes[rests + 1, 0])).tolist(), t[-1]]
    found = [
        _cycles_of(t, u, strokes[slice(*part)], *within)
        for part, within in zip(pairwise(edges), pairwise(limits), strict=True)
    ]
    return [one for one in found if one is not None]


def _cycles_of(t: Array, u: Array, strokes: Array, begin: float, end: float) -> Cycles | None:
    """Return the whole cycles of strokes between two times (s); None where there are none."""
    falls, rises = strokes[strokes[:, 2] < 0], strokes[strokes[:, 2] > 0]
    if len(falls) + len(rises) < 2:
        return None
    length = [np.median(s[:, 1] - s[:, 0]) if len(s) else np.inf for s in (falls, rises)]
    direction = 1 if length[0] <= length[1] else -1
    slip, slow = (falls, rises) if direction > 0 else (rises, falls)
    slip, period = _find_even(slip[:, :2], 2.0 * float(np.median(np.diff(t))))
    half = 0.5 * (slip[:, 1] - slip[:, 0])
    slips, ends = slip[:, 0] - half, np.minimum(slip[:, 1] + half, end)
    if len(slips) == 1:  # a whole stroke is twice as long as that between a quarter and three
        rise = float(slow[0, 1] - slow[0, 0])
        if not half[0] < 0.25 * rise or not 0.3 * rise < slip[0, 0] - slow[0, 1] < 0.8 * rise:
            return None  # such as strokes one way and the other, of two runs
        period = float(ends[0] - slow[0, :2].mean() + rise)
    first = float(ends[0] - period)
    starts = np.concatenate(([max(first, begin)], ends[:-1]))
    if first < begin - _SHORT * period:  # the first cycle began before the record
        starts, slips, ends = starts[1:], slips[1:], ends[1:]
    if not len(slips):
        return None
    cycles = zip(starts, ends, strict=True)
    parts = (u[slice(*np.searchsorted(t, one))] for one in cycles)
    stroke = settled_mean(np.array([np.ptp(one) if len(one) else np.nan for one in parts]))
    return Cycles(float(period), direction, starts, slips, ends, stroke)


def _share_of(u: Array) -> Array:
    """Return a signal as share of its range; a few samples may be spikes."""
    low, high = np.quantile(u, _OUTER) if len(u) > _MANY else np.array([u.min(), u.max()])
    return np.asarray((u - low) / (high - low))


def _find_even(slip: Array, resolution: float) -> tuple[Array, float]:
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
