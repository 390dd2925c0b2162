# SPDX-License-Identifier: Apache-2.0
"""What a change may come from: the likelihood of named causes, and which cannot be told apart.

Each cause is one parameter of unknown size, uniform over its range. The readings since the change
have a likelihood for each size, from the same filter as `tracker`, which knows the parameters of
before as well as that did; the mean over sizes is the evidence of the cause, and with equal odds
beforehand its posterior follows (Kass, Raftery 1995). Two causes that move the step by the same
share in all drives seen have the same evidence: they are named together.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from stickslip_ros.model import Plant
from stickslip_ros.parameters import ParameterError, Parameters
from stickslip_ros.twin.response import Blur, CycleCurve, Model, parts_of_cycles
from stickslip_ros.twin.settings import TwinSettings
from stickslip_ros.twin.timeline import OperatingPoint, Piece
from stickslip_ros.twin.tracker import THETA, ReadingFilter, Seen

Array = NDArray[np.float64]

#: Sizes that the kernel solves in a round of the search but the first, which is the cause's own;
#: rounds, each about the best of the one before; likely sizes of a round that is fine enough
_SOLVED, _ROUNDS, _BROAD = 9, 4, 5
#: Sizes of a cause of which it is looked whether there is such an axis
_TRIED = 65
#: A cause less likely than this is left out of those that cannot be told apart
_LEAST = 0.01
_REST = Piece(0.0, None, 0.0)
#: Readings between pauses
_PIECE = 50
T = TypeVar("T")
#: What is computed in pieces of some milliseconds; yields the s until the next, None: later
Pieces = Generator[float | None, None, T]
#: For each drive: numbers of readings, cycles and rests (2, parts) where parts begin and end
Parts = list[tuple[OperatingPoint, NDArray[np.int64], Array, Array]]
#: Standard deviations of the sum of squares beyond which no cause explains the readings
_MISFIT = 6.0


@dataclass(frozen=True)
class Cause:
    """One parameter of the axis or its sensor that may change, with sizes low to high."""

    parameter: str  #: "": of the sensor
    low: float
    high: float
    #: parameters and size -> value of the parameter
    value: Callable[[Parameters, float], float] = lambda p, size: size
    #: of the size, for people
    unit: str = ""
    #: whether the change stands at the place where it came and beyond, and not elsewhere
    local: bool = False
    #: sizes from low to high that are solved at first; ways in between are interpolated
    solved: int = 9

    def applied(self, p: Parameters, size: float) -> Parameters:
        """Return the parameters of the axis after the cause."""
        return p.replace(**{self.parameter: self.value(p, size)}) if self.parameter else p

    def reach(self, p: Parameters) -> tuple[float, float]:
        """Return the sizes, lowest and highest, after which there still is an axis."""
        sizes = np.linspace(self.low, self.high, _TRIED).tolist()
        possible = [size for size in sizes if self._leaves_an_axis(p, size)]
        return min(possible, default=0.0), max(possible, default=0.0)

    def _leaves_an_axis(self, p: Parameters, size: float) -> bool:
        try:
            Plant.of(self.applied(p, size))
        except ParameterError:
            return False
        return True


def _factor(name: str) -> Callable[[Parameters, float], float]:
    return lambda p, size: float(p.value(name)) * math.exp(size)


CAUSES: Mapping[str, Cause] = {
    "preload": Cause("preload", -0.9, 0.7, _factor("preload")),
    # The mass turns the phase of the ringing at the next slip, several times from low to high.
    "payload": Cause("mass", -0.5, 0.9, _factor("mass"), solved=65),
    "amplifier": Cause("gain", -0.4, 0.3, _factor("gain")),
    "sensor gain": Cause("", -0.3, 0.3),
    "temperature": Cause(
        "temperature", -40.0, 60.0, lambda p, by: p.actuator.temperature + by, "K"
    ),
    "place": Cause("preload", -0.9, 0.7, _factor("preload"), local=True),
}


@dataclass(frozen=True)
class Attribution:
    """What a change comes from."""

    posterior: Mapping[str, float]  #: of each cause
    sizes: Mapping[str, float]  #: the likeliest of each cause
    explained: bool  #: whether the likeliest cause explains the readings
    certainty: float

    @property
    def likeliest(self) -> str:
        """The likeliest cause."""
        return max(self.posterior, key=lambda name: self.posterior[name])

    @property
    def cause(self) -> str | None:
        """The cause that is as likely as asked for, None if there is none."""
        certain = self.explained and self.posterior[self.likeliest] >= self.certainty
        return self.likeliest if certain else None

    @property
    def possible(self) -> list[str]:
        """All causes that cannot be left out, the likeliest first."""
        possible = [name for name, share in self.posterior.items() if share >= _LEAST]
        return sorted(possible, key=lambda name: -self.posterior[name])

    def applied(self, p: Parameters, name: str) -> tuple[Parameters, float]:
        """Return parameters after a cause, and the gain of the sensor."""
        cause, size = CAUSES[name], self.sizes[name]
        return cause.applied(p, size), 1.0 if cause.parameter else math.exp(size)

    @property
    def text(self) -> str:
        """The verdict for people."""
        if not self.explained:
            return "unlike the model: no parameter explains it"
        if self.cause:
            return f"{self.cause} {self._size(self.cause)}"
        listed = [f"{name} {self._size(name)}" for name in self.possible]
        return f"{listed[0]}; it cannot be told from {', '.join(listed[1:])}"

    def _size(self, name: str) -> str:
        size = self.sizes[name]
        if CAUSES[name].unit:
            return f"{size:+.2g} {CAUSES[name].unit}"
        return f"{100.0 * math.expm1(size):+.2g} %"


def attribute(
    model: Model,
    covariance: Array,
    sensor_gain: float,
    seen: Sequence[Seen],
    place: float,
    settings: TwinSettings,
) -> Pieces[Attribution]:
    """Return what explains readings since a change at a place (m); pauses every few milliseconds.

    model, covariance (of logarithms of parameters) and the gain of the sensor are those of before.
    The first reading is where they begin.
    """
    p = model.p
    warms = p.actuator.gain_temperature or p.friction.friction_temperature
    causes = [name for name in CAUSES if name != "temperature" or warms]
    reaches = {name: CAUSES[name].reach(p) for name in causes}
    known = {name: CAUSES[name] for name, (low, high) in reaches.items() if low < high}
    yield None
    since = _Since(p, covariance, sensor_gain, seen, _parts_of(seen), place, settings)
    blurs = yield from since.blurs(model)
    best: dict[str, float] = {}
    evidence: dict[str, float] = {}
    for name, cause in known.items():
        best[name], evidence[name] = yield from _seek(since, cause, reaches[name], blurs)
    top = max(evidence, key=lambda name: evidence[name])
    shares = {name: math.exp(one - evidence[top]) for name, one in evidence.items()}
    total, count = sum(shares.values()), len(seen) - 1
    # Another mass rings in another way.
    own = yield from since.blurs(Model(known[top].applied(p, best[top])))
    ways = yield from since.ways(known[top], np.array([best[top]]))
    _, squares = yield from since.likelihood(ways, own)
    return Attribution(
        {name: share / total for name, share in shares.items()},
        best,
        float(squares[0]) <= count + _MISFIT * math.sqrt(2.0 * count),
        settings.certainty,
    )


@dataclass(frozen=True)
class _Since:
    """Readings since a change, and the axis before it."""

    p: Parameters
    covariance: Array
    sensor_gain: float
    seen: Sequence[Seen]
    parts: Parts
    place: float  #: where it changed, m
    settings: TwinSettings

    def ways(self, cause: Cause, sizes: Array) -> Pieces[Array]:
        """Return the ways (sizes, readings - 1) of a cause, m."""
        if not cause.parameter or cause.local:
            before = yield from self._ways(self.p)  # without a change
            if not cause.parameter:
                return np.asarray(before * np.exp(sizes)[:, None])
        ways = np.empty((len(sizes), len(self.seen) - 1))
        for k, size in enumerate(sizes.tolist()):
            ways[k] = yield from self._ways(cause.applied(self.p, size))
        if not cause.local:
            return ways
        positions = np.array([one.reading for one in self.seen[1:]])
        beyond = (positions - self.place) * (positions[0] - self.place) >= 0.0
        return np.where(beyond, ways, before)

    def _ways(self, p: Parameters) -> Pieces[Array]:
        found = np.zeros(len(self.seen) - 1)
        for drive, number, cycles, rest in self.parts:
            curve = CycleCurve.of(p, drive)
            way = curve.at(cycles[1], rest[1]) - curve.at(cycles[0], rest[0])
            found += np.bincount(number, way, len(found))
            yield None
        return self.sensor_gain * found

    def blurs(self, model: Model) -> Pieces[list[Blur]]:
        """Return the blur of each reading."""
        found = []
        for one in self.seen:
            piece, _, end = one.parts[-1] if one.parts else (_REST, 0.0, one.t)
            curve = model.curve(piece.drive) if piece.drive else None
            found.append(curve.blur(piece, end, self.settings.timing) if curve else Blur())
            if len(found) % _PIECE == 0:
                yield None
        return found

    def likelihood(self, ways: Array, blurs: Sequence[Blur]) -> Pieces[tuple[Array, Array]]:
        """Return logarithms of likelihoods and sums of squares of ways, (sizes,) each."""
        likely = ReadingFilter(len(self.covariance), self.settings.noise, ways.shape[:1])
        likely.covariance[THETA, THETA] = self.covariance
        likely.anchor(self.seen[0].reading, blurs[0].deviation)
        logs, squares = np.zeros(len(ways)), np.zeros(len(ways))
        for k, one in enumerate(self.seen[1:]):
            likely.go(ways[:, k], one.motion.slope, one.motion.scatter)
            found = likely.see(one.reading, blurs[k + 1])
            logs -= 0.5 * found.z**2 + math.log(found.deviation)
            squares += found.z**2
            if k % _PIECE == 0:
                yield None
        return logs, squares


def _seek(
    since: _Since, cause: Cause, reach: tuple[float, float], blurs: Sequence[Blur]
) -> Pieces[tuple[float, float]]:
    """Return the likeliest size of a cause within its reach, and the logarithm of its evidence."""
    (low, high), count = reach, cause.solved
    for _ in range(_ROUNDS):
        solved, sizes = np.linspace(low, high, count), np.linspace(low, high, 2 * count + 3)
        ways = yield from since.ways(cause, solved)
        logs, _ = yield from since.likelihood(CubicSpline(solved, ways)(sizes), blurs)
        k, width = int(np.argmax(logs)), float(sizes[1] - sizes[0])
        mean = float(np.exp(logs - logs[k]).sum()) * width
        if 2.0 * width < 1e-6 or (logs > logs[k] - 8.0).sum() > _BROAD:
            break
        low, high = max(reach[0], sizes[k] - width), min(reach[1], sizes[k] + width)
        count = _SOLVED
    return float(sizes[k]), float(logs[k]) + math.log(mean / (cause.high - cause.low))


def _parts_of(seen: Sequence[Seen]) -> Parts:
    """Return the parts of cycles before each reading but the first."""
    found: dict[OperatingPoint, list[tuple[int, Array, Array]]] = {}
    for k, one in enumerate(seen[1:]):
        for piece, begin, end in one.parts:
            if piece.drive is not None:
                found.setdefault(piece.drive, []).append((k, *parts_of_cycles(piece, begin, end)))
    parts = []
    for drive, all_of in found.items():
        number, cycles, rests = zip(*all_of, strict=True)
        parts.append((drive, np.array(number), np.array(cycles).T, np.array(rests).T))
    return parts
