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

Each cause is one parameter of unknown size in a range. The steps that the readings since the change
show at each drive (`step_regression`) have a likelihood for each size; the parameters of before are
known as well as the tracker knew them. Each cause counts by its likeliest size, with equal odds
beforehand: the mean over sizes would hold a cause for unlikely only because few of its sizes fit,
as of a payload, with which the phase of the ringing turns many times. Causes that explain the steps
about as well are named together.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from scipy.interpolate import CubicSpline

from stickslip_ros.base.arrays import Array
from stickslip_ros.measurement.twin.response import settled_step
from stickslip_ros.measurement.twin.settings import TwinSettings
from stickslip_ros.measurement.twin.step_regression import MISFIT
from stickslip_ros.measurement.twin.timeline import OperatingPoint
from stickslip_ros.measurement.twin.tracker import OFFSET, THETA, ShownStep, Tracker
from stickslip_ros.physics.model import Plant
from stickslip_ros.physics.parameters import ParameterError, Parameters

#: Shifts of the mean that are looked for, in standard deviations, in and against the direction
SHIFTS = np.array([sign * size for size in (0.25, 0.5, 1.0, 2.0, 3.0) for sign in (1.0, -1.0)])
#: Deviations beyond which a reading counts no more: two glitches alone make no alarm
_CUT = 3.0
#: Peaks of the likelihood that are looked into; sizes that the kernel solves about each; sizes that
#: are interpolated for each of them
_PEAKS, _SOLVED, _CLOSER = 3, 9, 64
#: Sizes that the kernel solves at first: at least, for each turn of the ringing, at most
_FEWEST, _PER_TURN, _MOST = 17, 12, 257
#: Ringing at the end of a cycle, as a fraction of the step, that does not move the next step
_FAINT = 1e-3
#: Sizes of a cause of which it is looked whether there is such an axis
_TRIED = 65
#: Deviation of the model's step, as a fraction of it
_MODEL = 3e-4
#: Change of a logarithm for a slope, within which the phase of the ringing hardly turns
_NEAR = 2e-3
#: A cause less likely than this is left out of those that cannot be told apart; causes are about as
#: likely from this fraction of the likeliest on
_LEAST, _ALIKE = 0.01, 0.3
#: Steps that are solved between pauses
_PIECE = 8
T = TypeVar("T")
#: What is computed in pieces of some milliseconds
Pieces = Generator[None, None, T]


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


#: Those first that a bench has most often
CAUSES: Mapping[str, Cause] = {
    "preload": Cause("preload", -0.9, 0.7, turns=True),
    "payload": Cause("mass", -0.5, 0.9, turns=True),
    "amplifier": Cause("gain", -0.4, 0.3),
    "breakaway distance": Cause("z_ba", -0.7, 0.5),
    "sensor gain": Cause("", -0.3, 0.3),
    "temperature": Cause("temperature", -40.0, 60.0, "K"),
    "place": Cause("preload", -0.9, 0.7, local=True, turns=True),
    "force": Cause("force", -0.03, 0.03, "N"),
}


@dataclass(frozen=True)
class Attribution:
    """What a change comes from."""

    posterior: Mapping[str, float]  #: of each cause, the likeliest first
    sizes: Mapping[str, float]  #: the likeliest of each cause
    after: Mapping[str, Parameters]  #: of the axis after each cause
    explained: bool  #: whether the likeliest cause explains the steps
    certainty: float

    @property
    def possible(self) -> list[str]:
        """All causes that cannot be left out, the likeliest first."""
        return [name for name, share in self.posterior.items() if share >= _LEAST]

    @property
    def adopted(self) -> str:
        """The cause that the model goes on with: the first of `CAUSES` that are about as likely."""
        least = _ALIKE * max(self.posterior.values())
        return next(name for name in CAUSES if self.posterior.get(name, 0.0) > least)

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


def attribute(
    before: Tracker, shown: Sequence[ShownStep], fits: bool, settings: TwinSettings
) -> Pieces[Attribution]:
    """Return what explains the steps since a change of an axis; pauses every few milliseconds.

    before is the axis before it, with its model made anew; fits: whether readings scatter as then.
    """
    p = before.model.p
    warms = p.actuator.gain_temperature or p.friction.friction_temperature
    best: dict[str, float] = {}
    logs: dict[str, float] = {}
    squares: dict[str, float] = {}
    for name, cause in CAUSES.items():
        low, high = cause.sizes(p)
        yield None
        if low < high and (warms or name != "temperature"):
            search = _Search(before, shown, cause)
            best[name] = size = yield from search.likeliest_size(low, high)
            logs[name], squares[name] = yield from search.judge(size)
    top, *_ = ranked = sorted(logs, key=lambda name: -logs[name])
    shares = {name: math.exp(logs[name] - logs[top]) for name in ranked}
    posterior = {name: share / sum(shares.values()) for name, share in shares.items()}
    after = {name: CAUSES[name].applied(p, size) for name, size in best.items()}
    explained = fits and squares[top] <= len(shown) + MISFIT * math.sqrt(2.0 * len(shown))
    return Attribution(posterior, best, after, explained, settings.certainty)


@dataclass(frozen=True)
class _Search:
    """Looks for the size of a cause that explains the steps since a change."""

    before: Tracker
    shown: Sequence[ShownStep]
    cause: Cause

    def likeliest_size(self, low: float, high: float) -> Pieces[float]:
        """Return the likeliest size of a cause from low to high."""
        slopes = np.array([self.before.slopes_of_step(one.drive) for one in self.shown])
        solved = np.linspace(low, high, self._to_solve(low, high))
        sizes, logs = yield from self._scan(solved, slopes)
        edged = np.concatenate(([-np.inf], logs, [-np.inf]))
        peaks = np.flatnonzero((logs >= edged[:-2]) & (logs >= edged[2:]))
        width, likeliest, most = float(solved[1] - solved[0]), 0.0, -math.inf
        for size in sizes[peaks[np.argsort(-logs[peaks])[:_PEAKS]]].tolist():
            near = np.linspace(max(low, size - width), min(high, size + width), _SOLVED)
            finer, logs = yield from self._scan(near, slopes)
            if (log := float(logs.max())) > most:
                likeliest, most = float(finer[np.argmax(logs)]), log
        return likeliest

    def judge(self, size: float) -> Pieces[tuple[float, float]]:
        """Return the logarithm of the likelihood of a size, and its sum of squares.

        The slopes are those after the change: those of before hold for others only roughly.
        """
        model, at = self.before.model, np.array([size])
        steps = yield from self._steps(model.p, at)
        slopes = np.empty((len(self.shown), len(self.before.names)))
        for i, name in enumerate(self.before.names):
            ends = []
            for by in (_NEAR, 0.0, -_NEAR):  # at the end of what a law allows in one direction
                with suppress(ParameterError):
                    p = model.p.replace(**{name: float(model.p.value(name)) * math.exp(by)})
                    ends.append((by, (yield from self._steps(p, at))[0]))
            (above, upper), *_, (below, lower) = ends
            slopes[:, i] = (upper - lower) / (above - below)
        logs, squares = self._likelihood(steps, slopes)
        return float(logs[0]), float(squares[0])

    def _to_solve(self, low: float, high: float) -> int:
        """Return how many sizes show how the step of each drive waves between low and high."""
        turns = 0.0
        for drive, *_ in self.shown if self.cause.turns else ():
            curve = self.before.model.curve(drive)
            if curve.lasting > _FAINT * abs(curve.step):
                # The frequency goes with the root of stiffness or mass.
                turns = max(turns, curve.ringing_frequency / drive.frequency * 0.5 * (high - low))
        return min(max(_FEWEST, math.ceil(_PER_TURN * turns)), _MOST)

    def _scan(self, solved: Array, slopes: Array) -> Pieces[tuple[Array, Array]]:
        """Return sizes, closer than those solved, and logarithms of their likelihoods."""
        steps = yield from self._steps(self.before.model.p, solved)
        sizes = np.linspace(solved[0], solved[-1], _CLOSER * (len(solved) - 1) + 1)
        logs, _ = self._likelihood(CubicSpline(solved, steps)(sizes), slopes)
        return sizes, logs

    def _steps(self, p: Parameters, sizes: Array) -> Pieces[Array]:
        """Return the steps after a cause of an axis of parameters p, (sizes, shown), m."""
        steps: dict[tuple[OperatingPoint, bool], list[float]] = {}
        columns = []
        for one in self.shown:
            changes = bool(self.cause.parameter) and (one.beyond or not self.cause.local)
            columns.append(steps.setdefault((one.drive, changes), []))
        for (drive, changes), column in steps.items():
            for size in sizes.tolist():
                after = self.cause.applied(p, size) if changes else p
                column.append(settled_step(after, drive))
                if len(column) % _PIECE == 0:
                    yield None
        gain = self.before.sensor_gain * (1.0 if self.cause.parameter else np.exp(sizes)[:, None])
        return np.asarray(gain * np.transpose(columns))

    def _likelihood(self, steps: Array, slopes: Array) -> tuple[Array, Array]:
        """Return logarithms of likelihoods and sums of squares of steps, (sizes,) each."""
        modelled = [self.before.modelled_step(one.drive) for one in self.shown]
        rows = np.array([row for _, row, _ in modelled])
        rows[:, THETA] = slopes
        errors = [variance + one.deviation**2 + (_MODEL * one.step) ** 2
                  for one, (*_, variance) in zip(self.shown, modelled, strict=True)]  # fmt: skip
        covariance = rows @ self.before.covariance @ rows.T + np.diag(errors)
        offsets = rows[:, OFFSET] * self.before.state[OFFSET]
        away = np.array([one.step for one in self.shown]) - steps - offsets
        squares = np.sum(away.T * np.linalg.solve(covariance, away.T), axis=0)
        return -0.5 * squares, squares
