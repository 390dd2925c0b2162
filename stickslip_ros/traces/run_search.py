# SPDX-License-Identifier: Apache-2.0
"""Where a measurement shows runs of steps: how many cycles, how long, which way.

At every slip the runner falls back, at even distances, while on the whole it gets ahead. Edges are
found by matched filters of all widths (a fall between two straight lines of equal slope); edges at
even distances are candidates. A candidate is a run if its cycles look alike, if it gets ahead, and
if it falls faster than it rises. The mean cycle then tells, cycle by cycle, where the run begins
and where it ends: one is counted if it goes with the mean cycle by half or more.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import scipy  # its parts load when they are used, which takes half a second
from numpy.typing import NDArray

from stickslip_ros.traces.evenly import EvenSamples

Array = NDArray[np.float64]

#: Fewest samples of a cycle in which a slip can be seen; widths of the edge filters in samples.
_COARSEST, _NARROWEST, _WIDEST = 6, 2, 24
#: An edge is so many standard deviations high, and this part of the highest ones.
_CLEAR, _PART = 4.5, 0.35
#: Distances of slips are even to this part and to so many samples.
_EVEN, _EVEN_SAMPLES = 0.15, 1.5
#: Phases of a mean cycle at most.
_PHASES = 200
#: Part of a period after the slip that a cycle is recognised by, too.
_BEYOND = 0.25
#: Part of the mean cycle that counts as a cycle.
_HALF = 0.5
#: Part of the variance of its cycles that the mean cycle of a run leaves unexplained at most.
_UNLIKE = 0.35
#: First cycles that may differ from the later ones; least part that a mean cycle leaves.
_TRANSIENT, _BEST = 7, 3e-3
#: Least power of all harmonics but the strongest as part of that one.
_HARMONICS = 0.02
#: A run of a shorter period is preferred to one that explains so much more.
_RIVAL, _ALIKE = 0.6, 0.015
#: Part by which a period that is known may be wrong.
_KNOWN = 0.05
#: Every so many cycles at most are looked at for being alike; part of the motion in which they are
#: more so than others.
_APART, _ALTERNATE = 8, 0.01
#: Frequencies of mains, Hz.
_MAINS = (50.0, 60.0)
#: Duration (s) of a run from which on hum is told from its trends.
_HUM_SEEN = 5e-3
#: Least step as part of the largest of all runs.
_SMALLEST = 0.1
#: Least step as part of the ripple.
_LEAST_STEP = 0.05
#: Weights of a parabola through five points at the middle one (Savitzky, Golay).
_SMOOTH = np.array([-3.0, 12.0, 17.0, 12.0, -3.0]) / 35.0
#: Cycles that are looked at, in stretches of so many.
_ROWS, _STRETCH = 320, 16
#: Candidates looked at.
_CANDIDATES = 16


@dataclass(frozen=True)
class Course:
    """Cycles of one run on a grid of slips: slip k begins about first + k period."""

    first: float  #: slip of the first cycle, s
    period: float  #: s
    count: int  #: cycles
    direction: int  #: +1 or -1
    step: float  #: how far it gets in a cycle, about, m; positive
    energy: float  #: how clear it is
    unlike: float = 0.0  #: part of the motion within cycles that is not the same in the next one

    @property
    def slips(self) -> Array:
        """Where the slips are, s, (cycles,)."""
        return self.first + self.period * np.arange(self.count, dtype=np.float64)

    @property
    def begin(self) -> float:
        """Begin of the first cycle, s."""
        return self.first - self.period

    @property
    def end(self) -> float:
        """Slip of the last cycle, s."""
        return self.first + self.period * (self.count - 1)


def search_runs(even: EvenSamples, period: float | None = None) -> list[Course]:
    """Return the runs in the order of time; the period (s) of some of them where it is known."""
    edges = [one for sign in (1, -1) for one in _edges(even, sign)]
    found: list[Course] = []
    if period is not None:
        known = [
            replace(one, period=period) for one in edges if abs(one.period / period - 1.0) < _KNOWN
        ]
        _find_all(even, known, found, period)
    _find_all(even, edges, found, None)
    largest = max((one.step for one in found), default=0.0)
    kept = [
        one
        for one in found
        if one.step > _SMALLEST * largest and not any(_rings(one, other) for other in found)
    ]
    return sorted(kept, key=lambda one: one.first)


def _find_all(
    even: EvenSamples, edges: list[Course], found: list[Course], period: float | None
) -> None:
    """Add to the runs found those that the edges are part of; of that period (s) if it is given."""
    seeds: list[Course] = []
    for seed in sorted(edges, key=lambda one: -one.energy):
        if not any(_same(seed, other) for other in seeds):
            seeds.append(seed)
    while True:
        seeds = [seed for seed in seeds if not any(_overlap(seed, other) for other in found)]
        course = _best_of(even, seeds[:_CANDIDATES], found, period)
        if course is None:
            return
        found.append(course)


def _best_of(
    even: EvenSamples, seeds: list[Course], found: list[Course], period: float | None
) -> Course | None:
    """Return the run that one of the seeds is part of and that explains most."""
    courses: list[Course] = []

    def consider(seed: Course) -> None:
        course = _checked(even, seed)
        if course is None or any(_overlap(course, other) for other in found):
            return
        if period is None or abs(course.period / period - 1.0) < _KNOWN:
            courses.append(course)

    for seed in seeds:
        if not any(_same(seed, other) for other in courses):
            consider(seed)
    if not courses:
        return None
    best = max(courses, key=lambda one: one.energy)
    # Ringing may repeat after a part of the period, and so do long cycles after several of them.
    for factor in (1.0 / 3.0, 0.5, 2.0, 3.0) if period is None else ():
        count = round(best.count / factor)
        if count >= 2 and factor * best.period > _COARSEST * even.tick:
            consider(replace(best, period=factor * best.period, count=count))
    best = max(courses, key=lambda one: one.energy)
    # What repeats after a time repeats after twice that time, too.
    rivals = [
        one
        for one in courses
        if _overlap(one, best)
        and one.period < best.period
        and one.energy > _RIVAL * best.energy
        and one.unlike < 1.5 * best.unlike + _ALIKE
    ]
    return min(rivals, key=lambda one: one.period, default=best)


def _rings(one: Course, other: Course) -> bool:
    """Return whether one is nothing but the ringing after the last slip of another run."""
    after = one.begin - other.end
    return one.period < 0.5 * other.period and -other.period < after < 2.0 * other.period


def _same(one: Course, other: Course) -> bool:
    """Return whether two are of one direction and period and lie about one another."""
    if one.direction != other.direction or abs(one.period / other.period - 1.0) > 0.03:
        return False
    return bool(one.begin < other.end and other.begin < one.end)


def _overlap(one: Course, other: Course) -> bool:
    """Return whether two runs share more than half a cycle of the longer period."""
    common = min(one.end, other.end) - max(one.begin, other.begin)
    return common > 0.5 * min(max(one.period, other.period), one.end - one.begin)


def edge_kernel(width: int) -> Array:
    """Return weights, (2 width,), that tell a fall from the width samples before and after.

    Straight lines of one slope through either side: their distance.
    """
    place = np.arange(-width, width) + 0.5
    side = np.where(place < 0.0, 1.0, -1.0)
    slope = float(side @ place / (place @ place))
    kernel = side - slope * place
    return np.asarray(kernel * 2.0 / float(kernel @ side))


def _edges(even: EvenSamples, direction: int) -> Iterator[Course]:
    """Yield falls at even distances as seen at every width."""
    width: float = _NARROWEST
    while len(even.x) > 4 * width:
        if width > _WIDEST:
            even, width = even.halved, 0.5 * width
        w = round(width)
        kernel = edge_kernel(w)
        x = direction * (even.x - even.x.mean())
        fall = scipy.signal.oaconvolve(x, kernel[::-1], mode="valid")  # of the edge at k + w
        spread = max(even.noise, 1e-15) * float(np.linalg.norm(kernel))
        least = max(_CLEAR * spread, 1e-12)
        if float(np.max(fall, initial=0.0)) > least:
            yield from _chains(even, fall, w, spread, least, direction)
        width *= math.sqrt(2.0)


def _chains(
    even: EvenSamples, fall: Array, width: int, spread: float, least: float, direction: int
) -> Iterator[Course]:
    peaks, seen = scipy.signal.find_peaks(fall, height=least, distance=max(1, width))
    heights = seen["peak_heights"]
    if len(peaks) < 2:
        return
    for part in (_PART, 0.7 * _PART, 0.0):
        kept = heights >= part * np.quantile(heights, 0.9)
        place, height = peaks[kept], heights[kept]
        apart = np.diff(place).astype(np.float64)
        # Neighbouring distances that are equal belong to one chain.
        alike = np.abs(np.diff(apart)) <= np.maximum(
            _EVEN * np.minimum(apart[1:], apart[:-1]), _EVEN_SAMPLES
        )
        bounds = np.flatnonzero(np.diff(np.concatenate(([0], alike.astype(np.int8), [0]))))
        chains = [(a, b + 1) for a, b in bounds.reshape(-1, 2)]
        taken = np.zeros(len(apart), dtype=bool)
        for a, b in chains:
            taken[a:b] = True
        chains += [(k, k + 1) for k in np.flatnonzero(~taken)]
        chains.sort(key=lambda one: -float(np.sum(height[one[0] : one[1] + 1] ** 2)))
        for a, b in chains[:20]:
            every = float(place[b] - place[a]) / (b - a)
            if every < max(_COARSEST, 1.6 * width):
                continue
            yield Course(
                even.begin + even.tick * (place[a] + width),
                even.tick * every,
                b - a + 1,
                direction,
                0.0,
                float(np.sum((height[a : b + 1] / spread) ** 2)) * (b - a) / (b - a + 2),
            )


def phases_of(even: EvenSamples, period: float) -> Array:
    """Return phases from one slip (-1) to a little after the next (0), in periods."""
    count = int(np.clip(period / even.tick, 8, _PHASES))
    return np.asarray((np.arange(math.ceil((1.0 + _BEYOND) * count)) + 0.5) / count - 1.0)


def cycles_on_grid(even: EvenSamples, slips: Array, period: float, phases: Array) -> Array:
    """Return the mean positions (m) about phases, (cycles, phases); nan where not known."""
    half = 0.5 * (phases[1] - phases[0])
    edges = np.append(phases - half, phases[-1] + half)
    return even.means(slips[:, None] + period * edges[None, :])


def some_cycles(count: int) -> NDArray[np.int64]:
    """Return numbers of cycles that tell of all of them: all, or stretches at even distances."""
    if count <= _ROWS:
        return np.arange(count)
    starts = np.linspace(0, count - _STRETCH, _ROWS // _STRETCH).astype(np.int64)
    return np.asarray(np.unique(starts[:, None] + np.arange(_STRETCH)))


def _mean_cycle(rows: Array) -> Array:
    """Return what rows have in common, without its mean, (phases,)."""
    about = rows - np.nanmean(rows, axis=1, keepdims=True)
    common = np.nanmedian(about, axis=0)
    return np.asarray(np.where(np.isfinite(common), common - np.nanmean(common), 0.0))


def _likeness(rows: Array, mean: Array) -> Array:
    """Return how much of the mean cycle each row holds, (cycles,); nan of rows not known."""
    known = np.isfinite(rows)
    share = np.where(known, mean, 0.0)
    count = np.maximum(known.sum(axis=1, keepdims=True), 1)
    share = np.where(known, share - share.sum(axis=1, keepdims=True) / count, 0.0)
    square = np.sum(share**2, axis=1)
    projected = np.sum(np.where(known, rows, 0.0) * share, axis=1)
    enough = (square > 0.5 * float(mean @ mean)) & (square > 0.0)
    return np.where(enough, projected / np.where(enough, square, 1.0), np.nan)


def _checked(even: EvenSamples, seed: Course) -> Course | None:
    """Return the whole run that a candidate is part of; None if it is none."""
    with warnings.catch_warnings(), np.errstate(invalid="ignore"):
        warnings.simplefilter("ignore", RuntimeWarning)  # rows within a gap have no mean
        course = _grown(even, seed)
        return None if course is None else _judged(even, course)


def _grown(even: EvenSamples, seed: Course) -> Course | None:
    sign, course = seed.direction, _at_the_fall(even, _in_step(even, seed))
    in_step = course.count
    for _ in range(40):
        phases = phases_of(even, course.period)
        reach = max(3, min(course.count // 2, _ROWS))
        before = min(reach, int((course.begin - even.begin) / course.period + 0.8))
        after = min(reach, int((even.end - course.end) / course.period + 0.3))
        number = np.concatenate(
            [np.arange(-max(before, 0), 0), some_cycles(course.count),
             course.count + np.arange(max(after, 0))]
        )  # fmt: skip
        slips = course.first + course.period * number
        rows = sign * cycles_on_grid(even, slips, course.period, phases)
        inside = (number >= 0) & (number < course.count)
        mean = _mean_cycle(rows[inside][1:] if course.count > 3 else rows[inside])
        rise = (phases > -0.85) & (phases < -0.04)
        if not np.ptp(mean[rise]) > 0.0:
            return None
        like = _likeness(rows[:, rise], mean[rise] - mean[rise].mean())
        first, last = _extent(like, number, course.count)
        if last - first < 1:
            return None
        grown = replace(course, first=course.first + first * course.period, count=last - first + 1)
        if grown.count > 1.4 * in_step:
            grown, in_step = _in_step(even, grown), grown.count
        refined = _at_the_fall(even, refine(even, grown))
        drifted = abs(refined.period - course.period) * grown.count > 0.02 * course.period
        unmoved = grown.count == course.count and first == 0
        course = refined
        if unmoved and not drifted:
            break
    return course


def _in_step(even: EvenSamples, course: Course) -> Course:
    """Return a run with the period near to its own at which its cycles have most in common."""
    if course.count < 3:
        return course
    phases = phases_of(even, course.period)
    number: Array = np.linspace(0, course.count - 1, min(course.count, 40)).round()
    middle = 0.5 * (course.count - 1)
    best, most = course, -1.0
    for share in np.linspace(-0.3, 0.3, 31):
        period = course.period * (1.0 + share / course.count)
        first = course.first + (course.period - period) * middle
        rows = cycles_on_grid(even, first + period * number, period, phases)
        rows = _without_trend(rows[np.isfinite(rows).all(axis=1)], phases, 1)
        common = float(np.var(rows.mean(axis=0))) if len(rows) > 1 else 0.0
        if common > most:
            best, most = replace(course, first=first, period=period), common
    return best


def _at_the_fall(even: EvenSamples, course: Course) -> Course:
    """Return a run whose slips are where its mean cycle falls fastest."""
    phases = phases_of(even, course.period)
    slips = course.slips[some_cycles(course.count)]
    rows = course.direction * cycles_on_grid(even, slips, course.period, phases)
    mean = _mean_cycle(rows[1:] if course.count > 2 else rows)
    width = max(2, len(phases) // 25)
    # A fall at the end of a cycle is seen from both sides; so the search is about there.
    fall = np.convolve(mean, edge_kernel(width)[::-1], mode="valid")
    place = phases[width : width + len(fall)] - 0.5 * (phases[1] - phases[0])
    near = np.abs(place) < 0.2
    if not near.any():
        return course
    at = float(place[near][int(np.argmax(fall[near]))])
    return replace(course, first=course.first + at * course.period)


def _extent(like: Array, number: NDArray[np.int64], count: int) -> tuple[int, int]:
    """Return numbers of the first and the last cycle of the unbroken run about the middle."""
    # A cycle that is not known (a gap) counts if those beside it do.
    known = np.isfinite(like)
    if not known.any():
        return 0, -1
    good = np.interp(number, number[known], like[known], left=0.0, right=0.0) > _HALF
    inside = np.flatnonzero(good & (number >= 0) & (number < count))
    if not len(inside):
        return 0, -1
    middle = int(inside[np.argmin(np.abs(number[inside] - count // 2))])
    bad = np.flatnonzero(~good)
    first = int(np.max(bad[bad < middle], initial=-1)) + 1
    last = int(np.min(bad[bad > middle], initial=len(good))) - 1
    return int(number[first]), int(number[last])


def refine(even: EvenSamples, course: Course) -> Course:
    """Return a run with first slip and period as all of its cycles together tell them.

    Each cycle has a place of its own (m) and is shifted by so much (s) that it lies on the mean
    cycle; the shifts lie on a line.
    """
    number = some_cycles(course.count)
    for _ in range(4):
        phases = phases_of(even, course.period)
        slips = course.slips[number]
        rows = course.direction * cycles_on_grid(even, slips, course.period, phases)
        used = number >= (1 if course.count > 2 else 0)
        mean = _mean_cycle(rows[used])
        shift = _shifts(rows, mean, phases, course.period)
        good = used & np.isfinite(shift)
        if good.sum() < 2:
            return course
        slope, about = _line_through(number[good].astype(np.float64), shift[good])
        course = replace(course, first=course.first + about, period=course.period + slope)
        if abs(slope) * course.count < 1e-3 * course.period:
            break
    return course


def _line_through(x: Array, y: Array) -> tuple[float, float]:
    """Return slope and cut of a line through points, those far off left out."""
    slope, cut = 0.0, float(np.median(y))
    for _ in range(3):
        away = np.abs(y - cut - slope * x)
        near = away <= 4.0 * float(np.median(away)) + 1e-30
        middle, level = float(x[near].mean()), float(y[near].mean())
        about = x[near] - middle
        square = float(about @ about)
        slope = float(about @ (y[near] - level)) / square if square > 0.0 else 0.0
        cut = level - slope * middle
    return slope, cut


def _shifts(rows: Array, mean: Array, phases: Array, period: float) -> Array:
    """Return by how much later (s) than the mean cycle each row is, (cycles,)."""
    smooth = np.convolve(np.pad(mean, 2, mode="edge"), _SMOOTH, mode="valid")
    known = np.isfinite(rows)
    count = np.maximum(known.sum(axis=1, keepdims=True), 1)
    left = np.where(known, rows - mean, 0.0)
    left = np.where(known, left - left.sum(axis=1, keepdims=True) / count, 0.0)
    rate = np.where(known, -np.gradient(smooth, phases * period), 0.0)
    rate = np.where(known, rate - rate.sum(axis=1, keepdims=True) / count, 0.0)
    square = np.sum(rate**2, axis=1)
    enough = (count[:, 0] > 0.6 * len(phases)) & (square > 0.0)
    delay = np.sum(rate * left, axis=1) / np.where(enough, square, 1.0)
    return np.where(enough, np.clip(delay, -0.1 * period, 0.1 * period), np.nan)


def _judged(even: EvenSamples, course: Course) -> Course | None:
    """Return the run with its step and how clear it is; None if it is none.

    Its later cycles look alike, it gets ahead, and it does more than swing.
    """
    phases = phases_of(even, course.period)
    slips = course.slips[:_ROWS]
    rows = course.direction * cycles_on_grid(even, slips, course.period, phases)
    rows = _filled(rows)
    first = min(_TRANSIENT, max(1, len(rows) // 2)) if len(rows) > 2 else 0
    later = rows[first:]
    mean = _mean_cycle(later)
    within = phases < 0.0  # the last slip is followed by rest
    about = _without_trend(later[:, within], phases[within], 1)
    known = np.isfinite(about).all(axis=1)
    about = about[known]
    if len(about) < 2:
        return None
    if course.period * course.count > _HUM_SEEN:
        times = (slips[first:, None] + course.period * phases[within])[known]
        about = about - _hum_in(about, times, phases[within])
    each = np.sort(np.mean(np.diff(about, axis=0) ** 2, axis=1))
    left = 0.5 * float(np.mean(each[: max(1, math.ceil(0.85 * len(each)))]))
    samples = course.period / even.tick
    chance = even.noise**2 * int(np.sum(within)) / samples
    beyond = max(left - chance, 0.0)
    if beyond > _UNLIKE * float(np.var(mean)):
        return None
    step = float(np.nanmedian(np.diff(np.nanmean(rows, axis=1))))
    error = even.noise / math.sqrt(samples) / course.count
    ripple = mean - step * phases
    if not step > max(6.0 * error, _LEAST_STEP * float(np.ptp(ripple))):
        return None
    error = math.sqrt(chance / len(later))
    if not float(np.ptp(ripple)) > 0.0:
        return None
    if not _is_no_sine(ripple[phases < 0.0], error) and not _rests(even, course, ripple, step):
        return None
    if _alternate(later, phases, course.period):
        return None
    power = float(np.var(ripple))
    unlike = beyond / power
    # The first cycle is what the others are like.
    energy = math.log1p(1.0 / (unlike + _BEST)) * (course.count - 1) * course.period
    return replace(course, step=step, energy=energy, unlike=unlike)


def _filled(rows: Array) -> Array:
    """Return rows with straight lines over short gaps."""
    filled = rows.copy()
    place = np.arange(rows.shape[1])
    for row in filled:
        known = np.isfinite(row)
        if 0.75 * len(row) < known.sum() < len(row):
            row[~known] = np.interp(place[~known], place[known], row[known])
    return filled


def _without_trend(rows: Array, phases: Array, degree: int) -> Array:
    """Return rows without a polynomial of their own each; a row of nan if it is not all known."""
    basis, _ = np.linalg.qr(np.vander(phases, degree + 1))
    return np.asarray(rows - (rows @ basis) @ basis.T)


def _hum_in(rows: Array, times: Array, phases: Array) -> Array:
    """Return the hum of the mains in rows that share a mean and have trends of their own."""
    columns = []
    for mains in _MAINS:
        for harmonic in (1, 2, 3):
            angle = 2.0 * math.pi * mains * harmonic * times
            for wave in (np.cos(angle), np.sin(angle)):
                column = _without_trend(wave, phases, 1)
                columns.append((column - column.mean(axis=0)).ravel())
    design = np.stack(columns, axis=1)
    own = (rows - rows.mean(axis=0)).ravel()
    found, *_ = np.linalg.lstsq(design, own, rcond=1e-3)
    return np.asarray((design @ found).reshape(rows.shape))


def _alternate(rows: Array, phases: Array, period: float) -> bool:
    """Return whether every second, third, ... row is more like one another than all are."""
    inner = (phases > -0.95) & (phases < -0.04)  # a slip lies between samples now so, now so
    rows, phases = rows[np.isfinite(rows).all(axis=1)][:, inner], phases[inner]
    width = len(phases) // 20  # ringing too fast for the phases is sampled by chance
    if width > 1:
        rows = np.asarray(scipy.ndimage.uniform_filter1d(rows, width, axis=1))
    for apart in range(2, min(_APART, len(rows) // 2) + 1):
        hum = any(abs(apart * period * mains - 1.0) < 0.05 for mains in _MAINS)
        about = _without_trend(rows, phases, 3 if hum else 1)
        total = float(np.sum((about - about.mean(axis=0)) ** 2))
        groups = [about[k::apart] for k in range(apart)]
        within = sum(float(np.sum((group - group.mean(axis=0)) ** 2)) for group in groups)
        between = (total - within) / (apart - 1)
        chance = within / (len(rows) - apart)
        clear = total - within > max(0.3 * total, _ALTERNATE * float(np.sum(about**2)))
        if clear and between > 6.0 * chance:
            return True
    return False


def _rests(even: EvenSamples, course: Course, ripple: Array, step: float) -> bool:
    """Return whether the axis rests beside the run: it neither swings as there nor gets ahead."""
    phases = phases_of(even, course.period)
    beside = [course.first - 1.3 * course.period, course.end + 2.3 * course.period]
    rows = course.direction * cycles_on_grid(even, np.array(beside), course.period, phases)
    rows = rows[np.isfinite(rows).all(axis=1)]
    if not len(rows):
        return False
    rows = rows - rows.mean(axis=1, keepdims=True)
    about = phases - phases.mean()
    ahead = np.abs(rows @ about) / float(about @ about)
    quiet = (np.std(rows, axis=1) < 0.5 * float(np.std(ripple))) & (ahead < 0.2 * step)
    return bool(quiet.any())


def _is_no_sine(ripple: Array, error: float) -> bool:
    """Return whether a cycle has more than one harmonic; error (m) is that of its samples."""
    power = np.abs(np.fft.rfft(ripple - ripple.mean())[1:]) ** 2
    first, *others = np.sort(power)[::-1]
    clear = 25.0 * error**2 * len(ripple)
    return bool(sum(others) > max(_HARMONICS * first, clear))
