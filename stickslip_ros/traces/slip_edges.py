# SPDX-License-Identifier: Apache-2.0
"""Falls at even distances: where runs of steps may be.

Edges are found by matched filters of all widths: a fall between two straight lines of equal slope.
Where the period is known, falls count that are clear only together (a comb).
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import scipy  # its parts load when they are used, which takes half a second

from stickslip_ros.arrays import Array
from stickslip_ros.traces.even_samples import EvenSamples, SlipGrid

#: Fewest samples of a cycle in which a slip can be seen; widths of the edge filters in samples.
COARSEST, _NARROWEST, _WIDEST = 6, 2, 24
#: Least heights of edges, in standard deviations and as parts, tried in turn, of this quantile.
_CLEAR, _PARTS, _HIGH = 4.5, (0.35, 0.245, 0.0), 0.9
#: Fall (m) that rounding makes.
_ROUNDING = 1e-12
#: Chains of edges that are handed on of each width and least height.
_CHAINS = 20
#: Distances of slips are equal within this part of them plus this many samples.
_EVEN, _EVEN_SAMPLES = 0.15, 1.5
#: Falls of a comb; combs handed on of each width.
_TEETH, _COMBS = 4, 6
#: Widths that slips are apart by, at least; periods that combs are.
_WIDTHS, _APART = 1.6, 0.7


def edge_kernel(width: int) -> Array:
    """Return weights, (2 width,), that show a fall between the width samples before and after.

    Straight lines of one slope through either side: their distance.
    """
    place = np.arange(-width, width) + 0.5
    side = np.where(place < 0.0, 1.0, -1.0)
    slope = float(side @ place / (place @ place))
    kernel = side - slope * place
    return np.asarray(kernel * 2.0 / float(kernel @ side))


def find_edges(even: EvenSamples, period: float | None = None) -> Iterator[SlipGrid]:
    """Yield falls at even distances as seen at every width; also of a period (s) that is known.

    Those of runs forward and backward.
    """
    width: float = _NARROWEST
    while len(even.x) > _TEETH * width:
        if width > _WIDEST:
            even, width = even.halved, 0.5 * width
        w = round(width)
        kernel = edge_kernel(w)
        x = even.x - even.x.mean()
        forward = np.convolve(x, kernel[::-1], mode="valid")  # the fall of the edge at k + w
        spread = max(even.noise, 1e-3 * _ROUNDING) * float(np.linalg.norm(kernel))
        least = max(_CLEAR * spread, _ROUNDING)
        for direction, fall in ((1, forward), (-1, -forward)):
            if float(np.max(fall, initial=0.0)) > least:
                yield from _chains(even, fall, w, spread, least, direction)
            if period is not None and period >= max(COARSEST, _WIDTHS * w) * even.tick:
                yield from _combs(even, fall, w, spread, direction, period)
        width *= math.sqrt(2.0)


def _combs(
    even: EvenSamples, fall: Array, width: int, spread: float, direction: int, period: float
) -> Iterator[SlipGrid]:
    """Yield a few falls one period (s) apart that are clear together."""
    apart = np.round(np.arange(_TEETH) * period / even.tick).astype(np.int64)
    count = len(fall) - int(apart[-1])
    if count < 1:
        return
    together = np.sum([fall[k : k + count] for k in apart], axis=0)
    least = max(_CLEAR * spread * math.sqrt(_TEETH), _ROUNDING)
    near = max(1, round(_APART * period / even.tick))
    peaks, seen = scipy.signal.find_peaks(together, height=least, distance=near)
    height = seen["peak_heights"]
    for k in np.argsort(-height, kind="stable")[:_COMBS]:
        score = (height[k] / spread) ** 2 / _TEETH * (_TEETH - 1) / (_TEETH + 1)
        first = even.begin + even.tick * (int(peaks[k]) + width)
        yield SlipGrid(first, period, _TEETH, direction, 0.0, float(score))


def _chains(
    even: EvenSamples, fall: Array, width: int, spread: float, least: float, direction: int
) -> Iterator[SlipGrid]:
    peaks, seen = scipy.signal.find_peaks(fall, height=least, distance=max(1, width))
    heights = seen["peak_heights"]
    if len(peaks) < 2:
        return
    for part in _PARTS:
        kept = heights >= part * np.quantile(heights, _HIGH)
        if kept.sum() < 2:
            continue
        place, height = peaks[kept], heights[kept]
        apart = np.diff(place).astype(np.float64)
        # Neighbouring distances that are equal belong to one chain.
        alike = np.abs(np.diff(apart)) <= np.maximum(
            _EVEN * np.minimum(apart[1:], apart[:-1]), _EVEN_SAMPLES
        )
        begins = np.flatnonzero(np.append(True, ~alike))
        ends = np.append(begins[1:], len(apart))
        total = np.append(0.0, np.cumsum(height**2)) / spread**2
        squares = total[ends + 1] - total[begins]
        for k in np.argsort(-squares, kind="stable")[:_CHAINS]:
            a, b = begins[k], ends[k]
            every = float(place[b] - place[a]) / (b - a)
            if every < max(COARSEST, _WIDTHS * width):
                continue
            yield SlipGrid(
                even.begin + even.tick * (place[a] + width),
                even.tick * every,
                b - a + 1,
                direction,
                0.0,
                float(squares[k]) * (b - a) / (b - a + 2),
            )
