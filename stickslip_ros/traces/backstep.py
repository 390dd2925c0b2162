# SPDX-License-Identifier: Apache-2.0
"""The mean backstep of a run, from the sliding arc itself, with the error of the method.

The backstep is how far the runner falls from where it is when the slip begins to the deepest point
after it. Until that point the contact slides, so the ringing that follows says nothing of it.
All settled slips are laid over one another, as the simulated ones are alike: their samples, taken
at other places of each cycle, draw the arc finer than one cycle does. A parabola of fourth order
through its bottom, and a line with ringing before the slip, give the two heights.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.traces.evenly import noise_of
from stickslip_ros.traces.ringing import Ringing
from stickslip_ros.traces.step_analysis import StepAnalysis
from stickslip_ros.traces.steps import settled_from

Array = NDArray[np.float64]


@dataclass(frozen=True)
class BackstepSettings:
    """How the arc is fitted; times in periods of the ringing."""

    cycles: int = 200  #: laid over one another at most: a period a bit off does not smear them
    bottom: float = 0.2  #: half the width of the bottom: a fourth order fits a swing there to 0.1 %
    lowest: tuple[float, float] = (0.1, 0.9)  #: where the deepest point may lie after the slip
    before: float = 1.5  #: what line and ringing before the slip are fitted to
    samples: int = 10  #: in the bottom, at least: two for each of the five unknowns
    gap: float = 0.08  #: longest gap in the bottom, over which an arc bends by 3 % of its depth
    #: Error of the method as part of the backstep: bend of the arc beyond fourth order, and the
    #: ringing left of the cycle before. From the study in the tests.
    method: float = 0.006


SETTINGS = BackstepSettings()


def folded_backstep(
    t: Array, forward: Array, found: StepAnalysis, settings: BackstepSettings = SETTINGS
) -> tuple[float, float]:
    """Return the mean backstep (m) of the settled cycles and its standard error (m).

    t (s) and forward (m, positive in the direction of the run) are the record, (samples,). Without
    noise or ringing, the mean of the single backsteps; nan where the samples show no arc.
    """
    count = max(len(found.slips) - 1, 1)  # the last one runs into rest
    settled = slice(settled_from(count), count)
    single = found.backsteps[settled]
    single = single[np.isfinite(single)]
    spread = float(np.std(single, ddof=1)) / math.sqrt(len(single)) if len(single) > 1 else math.nan
    noise = noise_of(forward)
    if not found.ringing_frequency > 0.0 or noise < _EXACT:
        return found.backstep, spread
    swing = 1.0 / found.ringing_frequency
    slips = found.slips[settled]
    slips = slips[np.unique(np.linspace(0, len(slips) - 1, settings.cycles).astype(int))]
    after, place = _folded(t, forward, slips, -settings.before * swing, 1.2 * swing)
    early = after < 0.0
    if early.sum() < settings.samples:
        return math.nan, math.nan
    level = _level(after[early], place[early], Ringing(found.ringing_frequency, found.decay))
    arc = _bottom(after, place, swing, settings)
    if arc is None:
        return math.nan, math.nan
    depth = max(level[0] - arc[0], 0.0)
    return depth, math.hypot(level[1], arc[1], settings.method * depth)


#: Positions without noise, as those of a simulation (m).
_EXACT = 1e-11


def _folded(t: Array, x: Array, slips: Array, begin: float, end: float) -> tuple[Array, Array]:
    """Return times about their slips (s) and places (m) of all samples there, in order.

    Each cycle counts from where it is just before its slip.
    """
    times, places = [], []
    for slip in slips:
        part = slice(*np.searchsorted(t, [slip + begin, slip + end]))
        since, place = t[part] - slip, x[part]
        if (since < 0.0).any():
            times.append(since)
            places.append(place - float(np.mean(place[since < 0.0])))
    if not times:
        return np.empty(0), np.empty(0)
    every, order = np.concatenate(times), np.argsort(np.concatenate(times), kind="stable")
    return every[order], np.concatenate(places)[order]


def _level(t: Array, x: Array, ringing: Ringing) -> tuple[float, float]:
    """Return where (m) the runner is when the slip begins, and its error (m).

    The runner rises evenly, and may still ring from the slip before.
    """
    since = t - t[0]
    design = np.column_stack([np.ones_like(t), t * ringing.frequency, *ringing.columns(since).T])
    found, *_ = np.linalg.lstsq(design, x, rcond=1e-6)
    left = x - design @ found
    at = np.concatenate(([1.0, 0.0], ringing.columns(np.array([-t[0]]))[0]))
    variance = float(left @ left) / max(len(x) - 4, 1)
    error = float(at @ np.linalg.pinv(design.T @ design) @ at)
    return float(at @ found), math.sqrt(variance * error)


def _fit(t: Array, x: Array, at: float, degree: int) -> tuple[float, float]:
    """Return the value (m) at a time (s) of a polynomial through places, and its error (m)."""
    scale = float(np.max(np.abs(t - at))) or 1.0
    design = np.vander((t - at) / scale, degree + 1, increasing=True)
    found, *_ = np.linalg.lstsq(design, x, rcond=None)
    left = x - design @ found
    variance = float(left @ left) / max(len(x) - degree - 1, 1)
    return float(found[0]), math.sqrt(variance * float(np.linalg.pinv(design.T @ design)[0, 0]))


def _bottom(
    t: Array, x: Array, swing: float, settings: BackstepSettings
) -> tuple[float, float] | None:
    """Return height (m) and its error (m) of the deepest point after the slip; None if unseen."""
    first, last = (part * swing for part in settings.lowest)
    inside = (t > first) & (t < last)
    if inside.sum() < settings.samples:
        return None
    width = settings.bottom * swing
    grid = np.linspace(first, last, 60)
    weights = np.exp(-0.5 * ((grid[:, None] - t[inside]) / (0.25 * width)) ** 2)
    smooth = weights @ x[inside] / np.maximum(weights.sum(axis=1), 1e-30)
    smooth[weights.sum(axis=1) < 0.1] = np.inf
    at = float(grid[int(np.argmin(smooth))])
    for _ in range(3):
        near = np.abs(t - at) <= width
        edges = np.concatenate(([at - width], t[near], [at + width]))
        if near.sum() < settings.samples or np.diff(edges).max() > settings.gap * swing:
            return None
        arc = np.polynomial.Polynomial.fit(t[near], x[near], 4)
        fine = np.linspace(max(at - width, t[near][0]), min(at + width, t[near][-1]), 201)
        moved = float(fine[int(np.argmin(arc(fine)))])
        if abs(moved - at) < 0.02 * swing:
            break
        at = moved
    near = np.abs(t - at) <= width
    return _fit(t[near], x[near], at, 4)
