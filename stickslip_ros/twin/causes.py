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
from collections.abc import Generator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
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
#: What is computed in pieces of some milliseconds
Pieces = Generator[None, None, T]
#: For each drive: numbers of readings, cycles and rests (2, parts) where parts begin and end
Parts = list[tuple[OperatingPoint, NDArray[np.int64], Array, Array]]
#: Standard deviations of the sum of squares beyond which no cause explains the readings
MISFIT = 6.0


@dataclass(frozen=True)
class Cause:
    """One parameter of the axis or its sensor that may change, with sizes low to high."""

    parameter: str  #: "": of the sensor
    low: float
    high: float
    unit: str = ""  #: of what is added to the parameter; without one a size is a logarithm
    #: whether the change stands at the place where it came and beyond, and not elsewhere
    local: bool = False
    #: sizes from low to high that are solved at first; ways in between are interpolated
    solved: int = 9

    def applied(self, p: Parameters, size: float) -> Parameters:
        """Return the parameters of the axis after the cause."""
        if not self.parameter:
            return p
        value = float(p.value(self.parameter))
        return p.replace(**{self.parameter: value + size if self.unit else value * math.exp(size)})

    def reach(self, p: Parameters) -> tuple[float, float]:
        """Return the sizes, lowest and highest, after which there still is an axis."""
        possible = [0.0]
        for size in np.linspace(self.low, self.high, _TRIED).tolist():
            with suppress(ParameterError):
                Plant.of(self.applied(p, size))
                possible.append(size)
        return min(possible), max(possible)


CAUSES: Mapping[str, Cause] = {
    "preload": Cause("preload", -0.9, 0.7),
    # The mass turns the phase of the ringing at the next slip, several times from low to high.
    "payload": Cause("mass", -0.5, 0.9, solved=65),
    "amplifier": Cause("gain", -0.4, 0.3),
    "sensor gain": Cause("", -0.3, 0.3),
    "temperature": Cause("temperature", -40.0, 60.0, "K"),
    "place": Cause("preload", -0.9, 0.7, local=True),
}


@dataclass(frozen=True)
class Attribution:
    """What a change comes from."""

    posterior: Mapping[str, float]  #: of each cause
    sizes: Mapping[str, float]  #: the likeliest of each cause
    after: Mapping[str, Parameters]  #: of the axis after each cause
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

    @property
    def sensor_gain(self) -> float:
        """The factor of the gain of the sensor, by the likeliest cause."""
        name = self.likeliest
        return 1.0 if CAUSES[name].parameter else math.exp(self.sizes[name])

    @property
    def text(self) -> str:
        """The verdict for people."""
        if not self.explained:
            return "unlike the model: no parameter explains it"
        listed = []
        for name in [self.cause] if self.cause else self.possible:
            size, unit = self.sizes[name], CAUSES[name].unit or "%"
            listed.append(f"{name} {size if unit != '%' else 100.0 * math.expm1(size):+.2g} {unit}")
        others = f"; it cannot be told from {', '.join(listed[1:])}" if listed[1:] else ""
        return listed[0] + others


@dataclass(frozen=True)
class ReadingsSince:
    """Readings since a change, and the axis before it."""

    model: Model  #: of the axis before
    covariance: Array  #: of logarithms of its parameters
    sensor_gain: float  #: before
    seen: Sequence[Seen]  #: the first is where they begin
    place: float  #: where it changed, m
    settings: TwinSettings

    def attribute(self) -> Pieces[Attribution]:
        """Return what explains the readings; pauses every few milliseconds."""
        p = self.model.p
        warms = p.actuator.gain_temperature or p.friction.friction_temperature
        blurs = yield from self._blurs(self.model)
        best: dict[str, float] = {}
        evidence: dict[str, float] = {}
        for name, cause in CAUSES.items():
            low, high = cause.reach(p)
            yield None
            if low < high and (warms or name != "temperature"):
                best[name], evidence[name] = yield from self._seek(cause, low, high, blurs)
        top = max(evidence, key=lambda name: evidence[name])
        shares = {name: math.exp(one - evidence[top]) for name, one in evidence.items()}
        total, count = sum(shares.values()), len(self.seen) - 1
        after = {name: CAUSES[name].applied(p, size) for name, size in best.items()}
        own = yield from self._blurs(Model(after[top]))  # another mass rings in another way
        ways = yield from self._ways(CAUSES[top], np.array([best[top]]))
        _, squares = yield from self._likelihood(ways, own)
        explained = bool(squares[0] <= count + MISFIT * math.sqrt(2.0 * count))
        posterior = {name: share / total for name, share in shares.items()}
        return Attribution(posterior, best, after, explained, self.settings.certainty)

    def _seek(
        self, cause: Cause, low: float, high: float, blurs: Sequence[Blur]
    ) -> Pieces[tuple[float, float]]:
        """Return the likeliest size of a cause from low to high, and its logarithmic evidence."""
        reach, count = (low, high), cause.solved
        for _ in range(_ROUNDS):
            solved, sizes = np.linspace(low, high, count), np.linspace(low, high, 2 * count + 3)
            ways = yield from self._ways(cause, solved)
            logs, _ = yield from self._likelihood(CubicSpline(solved, ways)(sizes), blurs)
            k, width = int(np.argmax(logs)), float(sizes[1] - sizes[0])
            mean = float(np.exp(logs - logs[k]).sum()) * width
            if 2.0 * width < 1e-6 or (logs > logs[k] - 8.0).sum() > _BROAD:
                break
            low, high = max(reach[0], sizes[k] - width), min(reach[1], sizes[k] + width)
            count = _SOLVED
        return float(sizes[k]), float(logs[k]) + math.log(mean / (cause.high - cause.low))

    def _ways(self, cause: Cause, sizes: Array) -> Pieces[Array]:
        """Return the ways (sizes, readings - 1) of a cause, m."""
        if not cause.parameter or cause.local:
            before = yield from self._ways_of(self.model.p)  # without a change
            if not cause.parameter:
                return np.asarray(before * np.exp(sizes)[:, None])
        ways = np.empty((len(sizes), len(self.seen) - 1))
        for k, size in enumerate(sizes.tolist()):
            ways[k] = yield from self._ways_of(cause.applied(self.model.p, size))
        if not cause.local:
            return ways
        positions = np.array([one.reading for one in self.seen[1:]])
        beyond = (positions - self.place) * (positions[0] - self.place) >= 0.0
        return np.where(beyond, ways, before)

    def _ways_of(self, p: Parameters) -> Pieces[Array]:
        found = np.zeros(len(self.seen) - 1)
        for drive, number, cycles, rest in self._parts:
            curve = CycleCurve.of(p, drive)
            way = curve.at(cycles[1], rest[1]) - curve.at(cycles[0], rest[0])
            found += np.bincount(number, way, len(found))
            yield None
        return self.sensor_gain * found

    def _blurs(self, model: Model) -> Pieces[list[Blur]]:
        """Return the blur of each reading."""
        found = []
        for one in self.seen:
            piece, _, end = one.parts[-1] if one.parts else (_REST, 0.0, one.t)
            curve = model.curve(piece.drive) if piece.drive else None
            found.append(curve.blur(piece, end, self.settings.timing) if curve else Blur())
            if len(found) % _PIECE == 0:
                yield None
        return found

    def _likelihood(self, ways: Array, blurs: Sequence[Blur]) -> Pieces[tuple[Array, Array]]:
        """Return logarithms of likelihoods and sums of squares of ways, (sizes,) each."""
        likely = ReadingFilter(len(self.covariance), self.settings.noise, ways.shape[:1])
        likely.covariance[THETA, THETA] = self.covariance
        likely.anchor(self.seen[0].reading, blurs[0])
        logs, squares = np.zeros(len(ways)), np.zeros(len(ways))
        for k, one in enumerate(self.seen[1:]):
            likely.go(ways[:, k], one.motion.slope, one.motion.scatter)
            found = likely.see(one.reading, blurs[k + 1])
            logs -= 0.5 * found.z**2 + math.log(found.deviation)
            squares += found.z**2
            if k % _PIECE == 0:
                yield None
        return logs, squares

    @cached_property
    def _parts(self) -> Parts:
        """The parts of cycles before each reading but the first."""
        found: dict[OperatingPoint, list[tuple[int, Array, Array]]] = {}
        for k, one in enumerate(self.seen[1:]):
            for piece, *ends in one.parts:
                if piece.drive is not None:
                    parts = (k, *parts_of_cycles(piece, *ends))
                    found.setdefault(piece.drive, []).append(parts)
        columns = {drive: zip(*all_of, strict=True) for drive, all_of in found.items()}
        return [
            (drive, np.array(number), np.array(cycles).T, np.array(rests).T)
            for drive, (number, cycles, rests) in columns.items()
        ]
