# SPDX-License-Identifier: Apache-2.0
"""The mean backstep of a run, with its error: the one estimate for all outputs.

The backstep is the fall of the runner from its position when the slip begins to the lowest point
after it. Until that point the contact slides, so the ringing after it gives little information.
The settled slips are superposed, because simulated ones are equal: their samples, at different
phases of each cycle, resolve the fall better than one cycle. A polynomial of fourth order through
the lowest part, and a line with ringing before the slip, give the two heights.

If the samples do not resolve the fall (too few in a swing, or synchronous with the drive), the
ringing after each slip is extrapolated into the fall; the backstep is the mean of the settled
cycles.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stickslip_ros.arrays import Array
from stickslip_ros.motion.settled import settled_from
from stickslip_ros.traces.cycles import Cycles
from stickslip_ros.traces.even_samples import rounding_of
from stickslip_ros.traces.measured_value import COVERAGE, MeasuredValue, estimate_settled_mean
from stickslip_ros.traces.ringing import Ringing

#: Positions without noise, as those of a simulation, m.
EXACT = 1e-11
#: Source of a backstep: the arc of the fall, the ringing after it, or samples of the fall.
ARC, RINGING, SAMPLES = "arc", "ringing", "samples"


@dataclass(frozen=True)
class BackstepSettings:
    """How the arc is fitted; times in periods of the ringing."""

    cycles: int = 200  #: laid over one another at most: a period a bit off does not smear them
    bottom: float = 0.2  #: half the width of the bottom: a fourth order fits a swing there to 0.1 %
    lowest: tuple[float, float] = (0.1, 0.9)  #: where the deepest point may lie after the slip
    before: float = 1.5  #: what line and ringing before the slip are fitted to
    after: float = 1.2  #: how long after the slip the fall is looked at
    pulled: float = 0.25  #: how long after the slip the runner is pulled back about evenly
    onset: float = 0.15  #: by how much the slip may begin earlier or later than was found
    places: int = 61  #: of it that are tried
    most: int = 4000  #: samples that tell the level
    samples: int = 10  #: in the bottom, at least: two for each of the five unknowns
    smooth: float = 0.25  #: of half the width of the bottom, by which it is smoothed to be found
    looks: int = 60  #: places at which the smoothed fall is looked at
    dense: float = 0.1  #: samples about such a place that show it, at least
    order: int = 4  #: of the arc
    fine: int = 201  #: places of the arc of which the deepest one counts
    settled: float = 0.02  #: by so little the deepest point moves in the end
    gap: float = 0.08  #: longest gap in the bottom, over which an arc bends by 3 % of its depth
    #: Error of the method as part of the backstep: bend of the arc beyond fourth order, and the
    #: ringing left of the cycle before. From the study in the tests.
    by_arc: float = 0.006
    #: The same where the ringing is drawn back into the fall, in which the contact slides.
    by_ringing: float = 0.02
    #: The same, and the samples of a swing with fewer of which the ringing itself is hardly known:
    #: a runner that rings falls up to twice as far as its mean.
    by_few: float = 0.5
    few: float = 4.0
    clock: float = 0.25  #: of a sample, to which slips are known
    #: Part of the backstep, and times the noise, by which falls without visible ringing differ.
    alike: float = 0.5
    loud: float = 2.0
    swings: float = 3.0  #: of a cycle, in fewer of which nothing shows where the slip begins


SETTINGS = BackstepSettings()


@dataclass(frozen=True)
class Backstep(MeasuredValue):
    """The mean backstep over the settled cycles, m; nan, or its error inf, if not determined."""

    chance: float  #: part of the error that noise and the scatter of cycles make, m
    method: str  #: its source: `ARC`, `RINGING` or `SAMPLES`


def estimate_backstep(
    t: Array,
    forward: Array,
    cycles: Cycles,
    ringing: Ringing | None,
    singles: Array,
    noise: float,
    exact: bool,
) -> Backstep:
    """Return the mean backstep of the settled cycles.

    t (s) and forward (m, positive in the direction of the run) are the record, (samples,); singles
    (m) are the backsteps cycle by cycle, (cycles,), and noise (m) is that of a sample. The last
    slip runs into rest, is a little longer, and counts only where it is the only one.
    """
    count, shared = max(len(cycles.slips) - 1, 1), math.sqrt(2.0) * rounding_of(forward, noise)
    if ringing is not None and noise >= EXACT:
        found = _by_arc(t, forward, cycles, slice(settled_from(count), count), ringing)
        if found is not None:
            depth, chance = max(found.value, 0.0), math.hypot(found.error, shared)
            error = math.hypot(chance, (SETTINGS.by_arc + _by_clock(t, cycles, ringing)) * depth)
            if found.value < -COVERAGE * chance:  # the slip is not where it was found
                error = math.inf
            return Backstep(depth, error, chance, ARC)
    mean = estimate_settled_mean(singles[:count], exact)
    if exact:
        return Backstep(mean.value, mean.error, mean.error, SAMPLES)
    # One fall alone shows no scatter; its fit takes more than one sample.
    chance = mean.error if math.isfinite(mean.error) or math.isnan(mean.value) else noise
    chance = math.hypot(chance, shared)
    if cycles.ends[0] == cycles.slips[0]:  # a slip is found to a sample, in which the runner goes
        last = len(cycles.slips) - 1
        risen = np.diff(np.interp(cycles.slips[[0, last]], t, forward))[0]
        ahead = abs(float(risen)) / max(last, 1) / cycles.period * float(np.median(np.diff(t)))
        chance = math.hypot(chance, 0.5 * ahead)
    interval = float(np.median(np.diff(t)))
    resolved = ringing is not None and ringing.frequency * interval * SETTINGS.few < 1.0
    part = SETTINGS.by_ringing if resolved else SETTINGS.by_few
    if ringing is not None:
        part += _by_clock(t, cycles, ringing)
    error = math.hypot(chance, part * mean.value)
    scatter = float(np.std(singles[settled_from(count) : count]))
    if ringing is None and scatter > max(SETTINGS.alike * mean.value, SETTINGS.loud * noise):
        error = math.inf  # a swing between the samples is seen at other places in each cycle
    return Backstep(mean.value, error, chance, SAMPLES if ringing is None else RINGING)


def _by_clock(t: Array, cycles: Cycles, ringing: Ringing) -> float:
    """Return the part of the backstep by which it is off as slips are known to a part of a sample.

    The ringing of the cycle before, half a backstep high at first, moves the runner meanwhile.
    """
    if cycles.ends[0] > cycles.slips[0]:  # the actuator tells them
        return 0.0
    late = SETTINGS.clock * float(np.median(np.diff(t)))
    turned = min(2.0 * math.pi * ringing.frequency * late, 1.0)
    return 0.5 * math.exp(-max(ringing.decay, 0.0) * cycles.period) * turned


def _by_arc(
    t: Array,
    forward: Array,
    cycles: Cycles,
    settled: slice,
    ringing: Ringing,
) -> MeasuredValue | None:
    """Return the backstep by the arc of the settled falls; None where samples show no arc."""
    swing = 1.0 / ringing.frequency
    slips = cycles.slips[settled]
    lasts = float(np.median(cycles.ends - cycles.slips))
    slips = slips[np.unique(np.linspace(0, len(slips) - 1, SETTINGS.cycles).astype(int))]
    after, place = _lay_over(
        t, forward, slips, -SETTINGS.before * swing, SETTINGS.after * swing + lasts
    )
    level = _level_at_slip(after, place, ringing)
    if level is None:
        return None
    arc = _fit_bottom(after, place, swing, lasts)
    if arc is None:
        return None
    return MeasuredValue(level.value - arc.value, math.hypot(level.error, arc.error))


def _lay_over(t: Array, x: Array, slips: Array, begin: float, end: float) -> tuple[Array, Array]:
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


def _level_at_slip(t: Array, x: Array, ringing: Ringing) -> MeasuredValue | None:
    """Return where (m) the runner is when the slip begins; None if too few samples show it.

    The runner rises evenly, and may still ring from the slip before. From the slip on it is pulled
    back. When that is, is known to a sample or a bias of the search only, but a runner that is fast
    then gets far meanwhile: so the level is the mean over all times, by how likely each is.
    """
    swing = 1.0 / ringing.frequency
    kept = t < SETTINGS.pulled * swing
    every = len(t) // SETTINGS.most + 1
    t, x = t[kept][::every], x[kept][::every]
    if (t < 0.0).sum() < SETTINGS.samples:
        return None
    since = t - t[0]
    before = np.column_stack([np.ones_like(t), t / swing, *ringing.columns(since).T])
    levels, squares, widths = [], [], []
    for begin in swing * np.linspace(-SETTINGS.onset, SETTINGS.onset, SETTINGS.places):
        pulled = np.maximum(t - begin, 0.0)[:, None] / swing
        design = np.hstack((before, pulled**2, pulled**3))
        found, *_ = np.linalg.lstsq(design, x, rcond=1e-6)
        at = np.concatenate(([1.0, begin / swing], ringing.columns(begin - t[:1])[0], [0.0, 0.0]))
        levels.append(float(at @ found))
        squares.append(float(np.sum((x - design @ found) ** 2)))
        widths.append(float(at @ np.linalg.pinv(design.T @ design) @ at))
    variance = max(min(squares) / max(len(x) - design.shape[1] - 1, 1), 1e-40)
    likely = np.exp(0.5 * (min(squares) - np.array(squares)) / variance)
    likely /= likely.sum()
    level = float(likely @ levels)
    spread = float(likely @ (np.array(levels) - level) ** 2) + variance * float(likely @ widths)
    return MeasuredValue(level, math.sqrt(spread))


def _fit_bottom(t: Array, x: Array, swing: float, lasts: float) -> MeasuredValue | None:
    """Return the height (m) of the deepest point after a slip that lasts so long; None if unseen.

    swing and lasts are in s.
    """
    first, last = SETTINGS.lowest[0] * swing, SETTINGS.lowest[1] * swing + lasts
    inside = (t > first) & (t < last)
    if inside.sum() < SETTINGS.samples:
        return None
    width = SETTINGS.bottom * swing
    grid = np.linspace(first, last, SETTINGS.looks)
    weights = np.exp(-0.5 * ((grid[:, None] - t[inside]) / (SETTINGS.smooth * width)) ** 2)
    smooth = weights @ x[inside] / np.maximum(weights.sum(axis=1), 1e-30)
    smooth[weights.sum(axis=1) < SETTINGS.dense] = np.inf
    at = float(grid[int(np.argmin(smooth))])
    for _ in range(3):
        near = np.abs(t - at) <= width
        edges = np.concatenate(([at - width], t[near], [at + width]))
        if near.sum() < SETTINGS.samples or np.diff(edges).max() > SETTINGS.gap * swing:
            return None
        arc = np.polynomial.Polynomial.fit(t[near], x[near], SETTINGS.order)
        bounds = max(at - width, t[near][0]), min(at + width, t[near][-1])
        fine = np.linspace(*bounds, SETTINGS.fine)
        moved = float(fine[int(np.argmin(arc(fine)))])
        if abs(moved - at) < SETTINGS.settled * swing:
            break
        at = moved
    near = np.abs(t - at) <= width
    t, x, unknowns = t[near], x[near], SETTINGS.order + 1
    design = np.vander((t - at) / (float(np.max(np.abs(t - at))) or 1.0), unknowns, increasing=True)
    found, *_ = np.linalg.lstsq(design, x, rcond=None)
    left = x - design @ found
    variance = float(left @ left) / max(len(x) - unknowns, 1)
    error = math.sqrt(variance * float(np.linalg.pinv(design.T @ design)[0, 0]))
    return MeasuredValue(float(found[0]), error)
