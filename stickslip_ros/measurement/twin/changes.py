# SPDX-License-Identifier: Apache-2.0
"""Tells a change, and what it may come from.

While nothing changes, the tracker's prediction of a reading is normal with the mean and deviation
that it states, whatever came before. So the likelihood ratio of a shifted mean is an e-value:
its expectation is 1. The procedure of Shiryaev and Roberts adds up the e-values of all times at
which a change may have begun,

    M_k = (M_(k-1) + w_k) L_k,

with the time w_k of stepping that reading k ends. M - t is then a martingale, so the alarm M >= A
comes after a time of A in the mean at the earliest (Shiryaev 1963; Pollak 1985; for mixtures of
alternatives as here, e-detectors: Shin, Ramdas, Rinaldo 2023, arXiv:2203.03532).

Each cause is one parameter of unknown size in a range. The readings since the change have a
likelihood for each size, from the same filter as `tracker`, which knows the parameters of before as
well as that did. Each cause counts by its likeliest size, with equal odds beforehand: the mean over
sizes would hold a cause for unlikely only because few of its sizes fit, as of a payload, with which
the phase of the ringing turns many times. Causes that explain the readings about as well are named
together.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np
from scipy.interpolate import CubicSpline

from stickslip_ros.base.arrays import Array
from stickslip_ros.measurement.twin.response import Blur, CycleCurve, Model, parts_of_cycles
from stickslip_ros.measurement.twin.settings import TwinSettings
from stickslip_ros.measurement.twin.timeline import OperatingPoint
from stickslip_ros.measurement.twin.tracker import THETA, ProcessedReading, ReadingFilter, Tracker
from stickslip_ros.physics.model import Plant
from stickslip_ros.physics.parameters import ParameterError, Parameters

#: Shifts of the mean that are looked for, in standard deviations, in and against the direction
SHIFTS = np.array([sign * size for size in (0.25, 0.5, 1.0, 2.0, 3.0) for sign in (1.0, -1.0)])
#: Deviations beyond which a reading counts no more: two glitches alone make no alarm
_CUT = 3.0
#: Sizes that the kernel solves in a round about a peak of the likelihood; rounds, each about the
#: best of the one before; likely sizes of a round that is fine enough
_SOLVED, _ROUNDS, _BROAD = 9, 4, 5
#: Peaks that are looked into
_PEAKS = 3
#: Sizes that the kernel solves at first: of others, at least, for each turn of the ringing, at most
_SMOOTH, _FEWEST, _PER_TURN, _MOST = 17, 65, 6, 257
#: Ringing at the end of a cycle, as a fraction of the step, that does not move the next step
_FAINT = 1e-3
#: Sizes of a cause of which it is looked whether there is such an axis
_TRIED = 65
#: Readings at rest from which on those between do not count
_LEAST_STILL = 10
#: Change of a logarithm for a slope, within which the phase of the ringing hardly turns
_NEAR = 2e-3
#: A cause less likely than this is left out of those that cannot be told apart
_LEAST = 0.01
#: Readings between pauses
_PIECE = 50
T = TypeVar("T")
#: What is computed in pieces of some milliseconds
Pieces = Generator[None, None, T]
#: Standard deviations of the sum of squares beyond which no cause explains the readings
MISFIT = 6.0


class ChangeDetector:
    """Sums evidence of a change; call `update` for each reading while the axis steps."""

    def __init__(self, interval: float) -> None:
        """Allow one false alarm in an interval (s) of stepping, in the mean."""
        self._interval = interval
        self.reset()

    def reset(self) -> None:
        """Begin anew, with no evidence."""
        self._sums = np.zeros(len(SHIFTS))  # evidence, s; an alarm where the mean is the interval
        self._runs = np.zeros(len(SHIFTS))  # logarithms of Page's sums, for the time of onset
        self._onsets = np.zeros(len(SHIFTS))

    @property
    def onset(self) -> float:
        """Time (s) at which the likeliest change began."""
        return float(self._onsets[np.argmax(self._runs)])

    def update(self, t: float, duration: float, deviation: float) -> bool:
        """Take a reading at t (s) after a duration (s) of stepping; return whether it is a change.

        deviation is that from the prediction, in its standard deviations, positive in the direction
        of the steps.
        """
        # A deviation is cut on the side where it would count: the ratio only falls by that.
        seen = np.minimum(np.sign(SHIFTS) * deviation, _CUT)
        log_ratio = np.abs(SHIFTS) * (seen - 0.5 * np.abs(SHIFTS))
        self._sums = (self._sums + duration) * np.exp(log_ratio)
        np.minimum(self._sums, 1e100, out=self._sums)
        begins = self._runs <= 0.0
        self._onsets[begins] = t - duration
        self._runs = np.where(begins, 0.0, self._runs) + log_ratio
        return bool(self._sums.mean() >= self._interval)


@dataclass(frozen=True)
class Cause:
    """One parameter of the axis or its sensor that may change, with sizes low to high."""

    parameter: str  #: "": of the sensor; one that is 0 has the value that the law calculates
    low: float
    high: float
    unit: str = ""  #: of what is added to the parameter; without one a size is a logarithm
    #: whether the change stands at the place where it came and beyond, and not elsewhere
    local: bool = False
    turns: bool = False  #: whether it turns the phase that the ringing has at the next slip

    def applied(self, p: Parameters, size: float) -> Parameters:
        """Return the parameters of the axis after the cause."""
        if not self.parameter:
            return p
        value = float(p.value(self.parameter) or 0.0)
        if not (value or self.unit):
            value = float(getattr(Plant.of(p).contact, self.parameter))
        return p.replace(**{self.parameter: value + size if self.unit else value * math.exp(size)})

    def sizes(self, p: Parameters) -> tuple[float, float]:
        """Return the sizes, lowest and highest, after which there still is an axis."""
        possible = [0.0]
        for size in np.linspace(self.low, self.high, _TRIED).tolist():
            with suppress(ParameterError):
                Plant.of(self.applied(p, size))
                possible.append(size)
        return min(possible), max(possible)


CAUSES: Mapping[str, Cause] = {
    "preload": Cause("preload", -0.9, 0.7, turns=True),
    "payload": Cause("mass", -0.5, 0.9, turns=True),
    "amplifier": Cause("gain", -0.4, 0.3),
    "breakaway distance": Cause("z_ba", -0.7, 0.5),
    "force": Cause("force", -0.03, 0.03, "N"),
    "sensor gain": Cause("", -0.3, 0.3),
    "temperature": Cause("temperature", -40.0, 60.0, "K"),
    "place": Cause("preload", -0.9, 0.7, local=True, turns=True),
}


@dataclass(frozen=True)
class Attribution:
    """What a change comes from."""

    posterior: Mapping[str, float]  #: of each cause, the likeliest first
    sizes: Mapping[str, float]  #: the likeliest of each cause
    after: Mapping[str, Parameters]  #: of the axis after each cause
    explained: bool  #: whether the likeliest cause explains the readings
    certainty: float

    @property
    def possible(self) -> list[str]:
        """All causes that cannot be left out, the likeliest first."""
        return [name for name, share in self.posterior.items() if share >= _LEAST]

    @property
    def cause(self) -> str | None:
        """The cause that is as likely as asked for, None if there is none."""
        likeliest, share = next(iter(self.posterior.items()))
        return likeliest if self.explained and share >= self.certainty else None

    @property
    def text(self) -> str:
        """The verdict for people."""
        if not self.explained:
            return "unlike the model: no parameter explains it"
        listed = []
        for name in [self.cause] if self.cause else self.possible:
            size, unit = self.sizes[name], CAUSES[name].unit or "%"
            listed.append(f"{name} {size if unit != '%' else 100.0 * math.expm1(size):+.2g} {unit}")
        if len(listed) == 1:
            return listed[0]
        return f"one of {', '.join(listed)}, which cannot be distinguished"


@dataclass(frozen=True)
class ReadingsSince:
    """Readings since a change, and the axis before it."""

    before: Tracker  #: of the axis before, with its model made anew
    seen: Sequence[ProcessedReading]  #: the first is where they begin
    place: float  #: where it changed, m
    settings: TwinSettings

    def attribute(self) -> Pieces[Attribution]:
        """Return what explains the readings; pauses every few milliseconds."""
        p = self.before.model.p
        warms = p.actuator.gain_temperature or p.friction.friction_temperature
        blurs = yield from self._blurs(self.before.model)
        best: dict[str, float] = {}
        fits: dict[str, float] = {}
        for name, cause in CAUSES.items():
            low, high = cause.sizes(p)
            yield None
            if low < high and (warms or name != "temperature"):
                best[name], fits[name] = yield from self._likeliest(cause, low, high, blurs)
        top, *_ = ranked = sorted(fits, key=lambda name: -fits[name])
        shares = {name: math.exp(fits[name] - fits[top]) for name in ranked}
        total, count = sum(shares.values()), sum(self._counts)
        after = {name: CAUSES[name].applied(p, size) for name, size in best.items()}
        own = yield from self._blurs(Model(after[top]))  # another mass rings otherwise
        _, squares = yield from self._judge_size(CAUSES[top], best[top], own)
        explained = bool(squares <= count + MISFIT * math.sqrt(2.0 * count))
        posterior = {name: share / total for name, share in shares.items()}
        return Attribution(posterior, best, after, explained, self.settings.certainty)

    def _likeliest(
        self, cause: Cause, low: float, high: float, blurs: Sequence[Blur]
    ) -> Pieces[tuple[float, float]]:
        """Return the likeliest size of a cause from low to high, and its logarithmic likelihood.

        Sizes are sought with the slopes of before the change, which hold for others only roughly;
        the best are judged by slopes of their own.
        """
        reach, count = (low, high), self._to_solve(cause, low, high)
        sizes, logs = yield from self._scan(cause, np.linspace(low, high, count), blurs)
        edged = np.concatenate(([-np.inf], logs, [-np.inf]))
        peaks = np.flatnonzero((logs >= edged[:-2]) & (logs >= edged[2:]))
        width, found = float(sizes[1] - sizes[0]), []
        for k in sorted(peaks, key=lambda k: -logs[k])[:_PEAKS]:
            found.append((yield from self._climb(cause, reach, float(sizes[k]), width, blurs)))
        size, _, width = max(found, key=lambda one: one[1])
        size, log, _ = yield from self._climb(cause, reach, size, width, blurs, judged=True)
        return size, log

    def _to_solve(self, cause: Cause, low: float, high: float) -> int:
        """Return how many sizes show how the step of each drive waves between low and high."""
        if not cause.turns:
            return _SMOOTH
        count = 0.0
        for drive in self._parts:
            curve = self.before.model.curve(drive)
            if curve.lasting > _FAINT * abs(float(curve.step)):
                # The frequency goes with the root of stiffness or mass.
                turns = curve.ringing_frequency / drive.frequency * 0.5 * (high - low)
                count = max(count, _PER_TURN * turns)
        return min(max(_FEWEST, math.ceil(count)), _MOST)

    def _scan(
        self, cause: Cause, solved: Array, blurs: Sequence[Blur]
    ) -> Pieces[tuple[Array, Array]]:
        """Return sizes, closer than those solved, and logarithms of their likelihoods."""
        moves = yield from self._moves(self.before.model.p, cause, solved)
        sizes = np.linspace(solved[0], solved[-1], 2 * len(solved) + 3)
        moves = CubicSpline(solved, moves)(sizes)
        logs, _ = yield from self._likelihood(moves, blurs, self._slopes_before)
        return sizes, logs

    def _climb(
        self,
        cause: Cause,
        reach: tuple[float, float],
        size: float,
        width: float,
        blurs: Sequence[Blur],
        judged: bool = False,
    ) -> Pieces[tuple[float, float, float]]:
        """Return the likeliest size within a width, its logarithm, and how wide the peak is."""
        for _ in range(_ROUNDS):
            sizes = np.linspace(max(reach[0], size - width), min(reach[1], size + width), _SOLVED)
            if judged:
                logs = yield from self._judge(cause, sizes, blurs)
            else:
                sizes, logs = yield from self._scan(cause, sizes, blurs)
            k, width = int(np.argmax(logs)), float(sizes[1] - sizes[0])
            size, likely = float(sizes[k]), np.flatnonzero(logs > logs[k] - 8.0)
            if 2.0 * width < 1e-6 or len(likely) > _BROAD:
                break
        around = max(size - float(sizes[likely[0]]), float(sizes[likely[-1]]) - size)
        return size, float(logs[k]), around + width

    def _judge(self, cause: Cause, sizes: Array, blurs: Sequence[Blur]) -> Pieces[Array]:
        """Return logarithms of likelihoods of sizes (sizes,), each with slopes of its own."""
        logs = np.empty(len(sizes))
        for k, size in enumerate(sizes.tolist()):
            logs[k], _ = yield from self._judge_size(cause, size, blurs)
        return logs

    def _judge_size(
        self, cause: Cause, size: float, blurs: Sequence[Blur]
    ) -> Pieces[tuple[float, float]]:
        """Return the logarithm of the likelihood of a size, and its sum of squares."""
        at, model = np.array([size]), self.before.model
        moves = yield from self._moves(model.p, cause, at)
        slopes = self._slopes_before.copy()
        for i, name in enumerate(self.before.names):
            ends = []
            for by in (_NEAR, -_NEAR):
                near = model.moved({name: by})
                try:
                    ends.append((yield from self._moves(near.p, cause, at))[0] if near else None)
                except ParameterError:  # at the end of what its law allows
                    ends.append(None)
            up, down = ends
            if up is not None and down is not None:
                slopes[:, i] = (up - down) / (2.0 * _NEAR)
        logs, squares = yield from self._likelihood(moves, blurs, slopes)
        return float(logs[0]), float(squares[0])

    @cached_property
    def _counts(self) -> list[bool]:
        """Which readings count: those at rest, where the ringing is over, if there are any.

        While the axis steps, readings lie in the ringing, whose phase is known to nobody after tens
        of its periods: a wrong cause that happens to follow it would be named with certainty.
        """
        motions = [one.motion for one in self.seen[1:]]
        still = [one.direction == 0 and one.blur.ringing < self.settings.noise for one in motions]
        return still if sum(still) >= _LEAST_STILL else [True] * len(still)

    @cached_property
    def _slopes_before(self) -> Array:
        """Slopes of the moves by the logarithms of parameters, (readings - 1, parameters), m."""
        return np.array([one.motion.slope for one in self.seen[1:]])

    def _moves(self, p: Parameters, cause: Cause, sizes: Array) -> Pieces[Array]:
        """Return the moves (sizes, readings - 1) after a cause of an axis of parameters p, m."""
        if not cause.parameter or cause.local:
            before = yield from self._moves_with(p)  # without a change
            if not cause.parameter:
                return np.asarray(before * np.exp(sizes)[:, None])
        moves = np.empty((len(sizes), len(self.seen) - 1))
        for k, size in enumerate(sizes.tolist()):
            moves[k] = yield from self._moves_with(cause.applied(p, size))
        if not cause.local:
            return moves
        positions = np.array([one.reading for one in self.seen[1:]])
        beyond = (positions - self.place) * (positions[0] - self.place) >= 0.0
        return np.where(beyond, moves, before)

    def _moves_with(self, p: Parameters) -> Pieces[Array]:
        found = np.zeros(len(self.seen) - 1)
        for drive, rows in self._parts.items():
            (number, begin, end, rest, rest_end), curve = np.array(rows).T, CycleCurve.of(p, drive)
            move = curve.at(end, rest_end) - curve.at(begin, rest)
            found += np.bincount(number.astype(np.int64), move, len(found))
            yield None
        return self.before.sensor_gain * found

    def _blurs(self, model: Model) -> Pieces[list[Blur]]:
        """Return the blur of each reading."""
        found = []
        for one in self.seen:
            piece, _, end = one.parts[-1] if one.parts else (None, 0.0, 0.0)
            found.append(Blur())
            if piece and piece.drive:
                found[-1] = model.curve(piece.drive).blur(piece, end, self.settings.timing)
            if len(found) % _PIECE == 0:
                yield None
        return found

    def _likelihood(
        self, moves: Array, blurs: Sequence[Blur], slopes: Array
    ) -> Pieces[tuple[Array, Array]]:
        """Return logarithms of likelihoods and sums of squares of moves, (sizes,) each."""
        likely = ReadingFilter(len(self.before.names), self.settings.noise, moves.shape[:1])
        likely.covariance[THETA, THETA] = self.before.covariance[THETA, THETA]
        likely.anchor(self.seen[0].reading, blurs[0])
        logs, squares = np.zeros(len(moves)), np.zeros(len(moves))
        for k, one in enumerate(self.seen[1:]):
            likely.move(moves[:, k], slopes[k], one.motion.scatter)
            if not self._counts[k]:
                continue
            _, deviation, z = likely.read(one.reading, blurs[k + 1])
            logs -= 0.5 * z**2 + math.log(deviation)
            squares += z**2
            if k % (_PIECE if len(moves) > 1 else 2 * _PIECE) == 0:  # one size takes less
                yield None
        return logs, squares

    @cached_property
    def _parts(self) -> dict[OperatingPoint, list[tuple[float, ...]]]:
        """For each drive numbers of readings, cycles and rests (s) at both ends of their parts."""
        found: dict[OperatingPoint, list[tuple[float, ...]]] = {}
        for k, one in enumerate(self.seen[1:]):
            for piece, *ends in one.parts:
                if piece.drive is not None:
                    cycles, rests = parts_of_cycles(piece, *ends)
                    found.setdefault(piece.drive, []).append((k, *cycles, *rests))
        return found
