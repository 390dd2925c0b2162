# SPDX-License-Identifier: Apache-2.0
"""The twin of an axis: takes commands and readings in the order of time, and says what it knows.

The same calls in the same order give the same numbers, in a node as from a file.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.library.ensemble import Ensemble
from stickslip_ros.model import Plant
from stickslip_ros.model.waveforms import drive_of
from stickslip_ros.parameters import PARAMETERS, ParameterError, Parameters
from stickslip_ros.reporting import CONFIDENCE, format_si
from stickslip_ros.twin.causes import CAUSES, Attribution, Pieces, attribute
from stickslip_ros.twin.detector import ChangeDetector
from stickslip_ros.twin.settings import TwinError, TwinSettings
from stickslip_ros.twin.timeline import RESTED, OperatingPoint, Timeline, TwinCommand
from stickslip_ros.twin.tracker import THETA, Seen, Tracker

Array = NDArray[np.float64]

OK, DRIFTING, CHANGED, UNLIKE, BLIND = "ok", "drifting", "changed", "unlike the model", "blind"
#: Readings that are kept for the judgement of a change; those after it that it leaves out, as its
#: onset is known no better, and the position may have jumped with it
_KEPT, _UNSURE = 4000, 10
#: Factor between the numbers of readings at which a change is judged again
_AGAIN = 4
#: s of readings between pieces of a judgement, each of which takes some milliseconds
_PACE = 0.01
#: What the logarithm of the preload may be after a change, until its cause is judged
_REOPENED = 0.3
#: s between the entries of the history, and their number, from which every second is dropped
_PERIOD, _MOST = 1.0, 4000
#: Share of its deviation beforehand below which a parameter counts as seen
_SEEN = 0.5


class Update(NamedTuple):
    """A reading and what was expected of it."""

    t: float  #: s
    measured: float  #: m
    expected: float  #: m
    deviation: float  #: standard deviation of the difference, m
    changed: bool  #: whether this reading tells a change


class TrackedParameter(NamedTuple):
    """A parameter with the ends of its 95 % interval."""

    name: str
    unit: str
    value: float
    low: float
    high: float
    seen: bool  #: whether the data narrow it; what they do not excite is held


@dataclass
class Change:
    """A change that was told."""

    told: float  #: s
    onset: float  #: s, the likeliest
    step_before: float  #: m
    step_after: float  #: m, as known now
    drive: OperatingPoint  #: of these steps
    at_start: bool  #: whether the first steps already were other ones than the file says
    verdict: Attribution | None = None  #: None until there are readings enough

    @property
    def text(self) -> str:
        """The change for people."""
        sizes = " to ".join(format_si(one, "m", 5) for one in (self.step_before, self.step_after))
        when = "from the start, so the file is not of this axis as it is"
        text = f"step {sizes}, {when if self.at_start else f'since {self.onset:.6g} s'}"
        cause = self.verdict.text if self.verdict else "not judged yet"
        return f"{text} (told at {self.told:.6g} s); cause: {cause}"


class Forecast(NamedTuple):
    """Where a move ends."""

    steps: int  #: sign: direction
    begin: float  #: s
    end: float  #: s
    position: float  #: m
    low: float  #: m, of the 95 % interval
    high: float


class Twin:
    """The model beside an axis. Time (s) is passed in."""

    def __init__(
        self,
        p: Parameters,
        settings: TwinSettings | None = None,
        ensemble: Ensemble | None = None,
    ) -> None:
        """Start from the parameters of the axis and, if there is one, the ensemble of their fit."""
        self.settings = settings or TwinSettings()
        self.tracker = Tracker(p, self.settings, ensemble)
        self.timeline = Timeline(p.drive.amplitude, p.drive.frequency)
        self.detector = ChangeDetector(self.settings.false_alarm_interval)
        self.changes: list[Change] = []
        self.history: list[tuple[float, list[TrackedParameter]]] = []  #: times (s), estimates
        self.troubles: Counter[str] = Counter()  #: gaps, doubled readings and the like, by name
        self.t = math.nan  #: of the last reading, s
        self.driven = 0.0  #: s of stepping seen
        self._steady = -math.inf  # since when nothing was told, s
        self._begun = math.nan  # time of the first reading that showed cycles, s
        self._excited = -math.inf  # time of the last reading that showed cycles, s
        self._judging: Pieces[None] | None = None
        self._go_on_at = 0.0  # s, when the next piece of the judgement is due
        self._fresh: list[Seen] = []  # those that come while it ends
        self._seen: deque[tuple[Seen, Array]] = deque(maxlen=_KEPT)
        self._judge_at = 0  # readings since the last change at which it is judged, 0: never
        self._since = 0
        self._before = self.tracker.model  # before the last change
        # and how well, and the sensor's gain
        self._known = self.tracker.covariance[THETA, THETA], 1.0
        self._drive: OperatingPoint | None = None  # of the last cycles

    # -- taking

    def command(self, command: TwinCommand) -> None:
        """Take a command; they come in the order of time, each before later readings."""
        if not (math.isfinite(command.t) and math.isfinite(command.value)):
            self.troubles["commands that are no numbers"] += 1
            return
        if not self._possible(command):
            self.troubles["commands that no axis like this carries out"] += 1
            return
        if command.name == "start" and not command.t < self.t:  # an older one is history
            if not math.isnan(self.t):
                self.troubles["restarts of the axis"] += 1
            self.t = math.nan
        self.timeline.take(command)

    def _possible(self, command: TwinCommand) -> bool:
        drive = {"amplitude": self.timeline.amplitude, "frequency": self.timeline.frequency}
        if command.name in drive:
            drive[command.name] = command.value
        elif command.name == "jog" and command.value:
            drive["frequency"] = abs(command.value)
        try:
            drive_of(self.tracker.model.p.replace(**drive))
        except ParameterError:
            return False
        return True

    def measure(self, t: float, reading: float) -> Update | None:
        """Take a reading (m) with its time stamp (s); None if it is of no use by itself."""
        t -= self.settings.latency
        if not (math.isfinite(t) and math.isfinite(reading)):
            self.troubles["readings that are no numbers"] += 1
            return None
        if t <= self.t:
            self._note_old(t)
            if not math.isnan(self.t):
                return None
        duration = t - self.t
        if math.isnan(self.t) or duration > self.settings.longest_gap:
            if not math.isnan(self.t):
                self.troubles["gaps"] += 1
            self._anchor(t, reading)
            return None
        if self.timeline.blind_between(self.t, t):
            self.troubles["readings during unknown cycles"] += 1
            self._anchor(t, reading)
            return None
        return self._take(t, reading, duration)

    def _note_old(self, t: float) -> None:
        if self.t - t > self.settings.longest_gap:
            self.troubles["jumps of the clock"] += 1
            self.t = math.nan
            self.timeline.clear()
        else:
            self.troubles["doubled readings" if t == self.t else "late readings"] += 1

    def _anchor(self, t: float, reading: float) -> None:
        self.tracker.anchor(reading)
        self.timeline.forget(t)
        self._seen.clear()
        self._judge_at, self._judging = 0, None
        self.t = t

    def _take(self, t: float, reading: float, duration: float) -> Update:
        tracker, before = self.tracker, self.tracker.theta.copy()
        parts = list(self.timeline.between(self.t, t))
        motion = tracker.motion(parts)
        seen = Seen(t, reading, parts, motion)
        found = tracker.take(seen, duration)
        self._seen.append((seen, before))
        self._fresh.append(seen)
        self._since += 1
        self.t = t
        self.timeline.forget(t)
        if found.jumped:
            self.troubles["jumps of the position"] += 1
        changed = False
        if motion.direction:
            if not self.driven:
                self._begun = t
            self.driven += duration
            self._excited = t
            self._drive = next(p.drive for p, _, _ in reversed(parts) if p.drive)
            if not self._pending and self.detector.see(t, duration, motion.direction * found.z):
                self._change(reading)
                changed = True
        self._go_on_judging()
        self._note()
        return Update(t, reading, found.expected, found.deviation, changed)

    def _note(self) -> None:
        """Add to the history, once in a period."""
        if self._drive is None:
            return
        if self.changes and self._judge_at:
            self.changes[-1].step_after = self.tracker.step_size(self.changes[-1].drive)[0]
        if not self.history or not 0.0 <= self.t - self.history[-1][0] < _PERIOD:
            self.history.append((self.t, self.estimates()))
            if len(self.history) > _MOST:
                del self.history[::2]

    # -- changes

    def _change(self, reading: float) -> None:
        """Tell a change, and let the estimates find what holds now."""
        onset, tracker = self.detector.onset, self.tracker
        theta = next((theta for one, theta in self._seen if one.t > onset), tracker.theta)
        assert self._drive
        self._before = tracker.model_at(theta) or tracker.model
        step = tracker.sensor_gain * self._before.curve(self._drive).step
        # It was never seen to fit for longer than it was seen not to.
        at_start = not self.changes and onset - self._begun <= self.t - onset
        self.changes.append(Change(self.t, onset, step, step, self._drive, at_start))
        self._since = sum(one.t > onset for one, _ in self._seen)
        self._judge_at = self.settings.judged_from
        self._known = tracker.covariance[THETA, THETA].copy(), tracker.sensor_gain
        tracker.reopen("preload", _REOPENED)
        self._judging = None
        tracker.anchor(reading)
        self.detector.reset()
        self._steady = self.t

    @property
    def _pending(self) -> bool:
        """Whether a change waits for its first verdict: until then, one is told at a time."""
        judging = self._judging is not None and self.changes[-1].verdict is None
        return judging or self._judge_at == self.settings.judged_from

    def _go_on_judging(self) -> None:
        """Judge the last change, later once more: a piece now and then."""
        if self._judge_at and self._since >= self._judge_at:
            again = self._judge_at * _AGAIN
            self._judge_at = again if again <= _KEPT else 0
            self._judging, self._go_on_at = self._judge(self.changes[-1]), self.t
        if self._judging is None:
            self._fresh.clear()
        elif self.t >= self._go_on_at:
            try:
                self._go_on_at = self.t + (next(self._judging) or _PACE)
            except StopIteration:
                self._judging = None

    def settle(self) -> None:
        """Judge the last change by what there is: no more readings come."""
        if self._pending and self._judging is None:
            self._judge_at, self._judging = 0, self._judge(self.changes[-1])
        for _ in self._judging or ():
            pass
        self._judging = None

    def _judge(self, change: Change) -> Pieces[None]:
        """Judge a change by all readings since; those that come meanwhile count at the end."""
        readings = [one for one, _ in self._seen]
        first = next((k for k, one in enumerate(readings) if one.t > change.onset), 0)
        kept, (covariance, gain) = readings[first + _UNSURE :], self._known
        if len(kept) <= self.settings.judged_from // 2:
            return
        place = readings[first].reading
        verdict = yield from attribute(self._before, covariance, gain, kept, place, self.settings)
        new = not change.verdict or change.verdict.likeliest != verdict.likeliest
        if verdict.explained and new:
            p, factor = verdict.applied(self._before.p, verdict.likeliest)
            name, count = CAUSES[verdict.likeliest].parameter, self.settings.judged_from
            self._fresh[:] = [one for one, _ in self._seen][-count:]
            rebased = self.tracker.rebased(p, name, gain * factor, covariance, self._fresh)
            self.tracker = yield from rebased
            self._steady = self.t
        change.verdict = verdict

    # -- what is known

    @property
    def level(self) -> tuple[str, str]:
        """The level and its reason, for people."""
        settings = self.settings
        if math.isnan(self.t):
            return BLIND, "no position was heard"
        if not self.t - self._excited <= settings.blind_after:
            return BLIND, f"no step was seen for {settings.blind_after:g} s; estimates are held"
        change = self.changes[-1] if self.changes else None
        verdict = next((one.verdict for one in reversed(self.changes) if one.verdict), None)
        if self.tracker.lost or (verdict and not verdict.explained):
            return UNLIKE, change.text if change else "the estimates leave the model's range"
        if change and self.t - change.told < settings.drift_window:
            return CHANGED, change.text
        rate, deviation = self.drift
        if abs(rate) > settings.drift_errors * deviation:
            return DRIFTING, f"the step changes by {360_000.0 * rate:+.2g} % an hour"
        return OK, "as expected"

    @property
    def drift(self) -> tuple[float, float]:
        """Rate of the step over the last window as a share of it, 1/s, and its standard error."""
        if not self.history:
            return 0.0, math.inf
        window, last = self.settings.drift_window, self.history[-1]
        first = max(last[0] - window, self._steady)
        begin, *then = next((one for one in self.history if one[0] > first), last)
        if (lasts := last[0] - begin) < 0.5 * window:
            return 0.0, math.inf
        old, new = then[0][-1], last[1][-1]  # the step is the last of the estimates
        scale = abs(old.value) * lasts
        width = math.hypot(new.high - new.low, old.high - old.low)
        return (new.value - old.value) / scale, 0.5 * width / (CONFIDENCE * scale)

    def estimates(self) -> list[TrackedParameter]:
        """Return the parameters, the breakaway distance and the step size with their intervals."""
        tracker, found = self.tracker, []
        deviations = tracker.deviations
        for k, name in enumerate(tracker.names):
            value = float(tracker.values[k])
            wide = math.exp(CONFIDENCE * deviations[k])
            others = [value, *self._of_other_causes(name)]
            ends = min(others) / wide, max(others) * wide
            seen = len(others) == 1 and deviations[k] < _SEEN * tracker.prior[k]
            found.append(TrackedParameter(name, PARAMETERS[name].unit, value, *ends, bool(seen)))
        preload = next(one for one in found if one.name == "preload")
        p = tracker.model.p
        z_ba = [_breakaway_distance(p, one) for one in preload[2:5]]
        found.append(
            TrackedParameter("breakaway distance", "m", z_ba[0], z_ba[1], z_ba[2], preload.seen)
        )
        if self._drive is not None:
            step, deviation = tracker.step_size(self._drive)
            half = CONFIDENCE * deviation
            found.append(TrackedParameter("step size", "m", step, step - half, step + half, True))
        return found

    def _of_other_causes(self, name: str) -> list[float]:
        """Return the values of a parameter if the last change had another cause."""
        verdict = self.changes[-1].verdict if self.changes else None
        if verdict is None or not verdict.explained:
            return []
        rest = [verdict.applied(self._before.p, one)[0] for one in verdict.possible[1:]]
        return [float(p.value(name)) for p in rest]

    # -- what comes

    def predict_steps(self, steps: int) -> Forecast:
        """Return where steps (sign: direction) end that begin as soon as the axis rests.

        Raises TwinError while the axis steps without end, or before there is a reading.
        """
        running = self.timeline.pieces[-1] if self.timeline.pieces else None
        if math.isnan(self.t):
            raise TwinError("there is no reading to predict from; give the position first")
        if running and math.isinf(running.end) and running.drive:
            raise TwinError("the axis steps without end; stop it, then ask for a prediction")
        if running and running.drive is None and self.timeline.blind_between(self.t, math.inf):
            raise TwinError("the axis follows a closed loop; stop it, then ask for a prediction")
        begin = max(self.t, running.end if running and running.drive else self.t)
        parts = list(self.timeline.between(self.t, begin))
        piece = self.timeline.piece(begin, 1 if steps >= 0 else -1, float(abs(steps)))
        if steps:
            parts.append((piece, begin, piece.end + RESTED))
        motion = self.tracker.motion(parts)
        x, deviation = self.tracker.forecast(motion, piece.end + RESTED - self.t)
        half = CONFIDENCE * deviation
        return Forecast(steps, begin, piece.end, x, x - half, x + half)

    def predict_position(self, target: float) -> Forecast:
        """Return the steps that end nearest to a target (m), and where they end.

        Raises TwinError as `predict_steps`, and where the steps do not lead to the target.
        """
        way = target - self.predict_steps(0).position
        direction = 1 if way >= 0.0 else -1
        drive = self.timeline.piece(self.t, direction, 1.0).drive
        assert drive
        step, _ = self.tracker.step_size(drive)
        if not step * direction > 0.0:
            raise TwinError("the axis makes no steps in that direction; raise the amplitude")
        near = round(way / step)
        return min(
            (self.predict_steps(direction * max(near + more, 0)) for more in (-1, 0, 1)),
            key=lambda found: abs(found.position - target),
        )


def _breakaway_distance(p: Parameters, preload: float) -> float:
    """Return z_ba (m) at a preload (N), nan where the law does not know it."""
    try:
        return float(Plant.of(p.replace(preload=preload)).contact.z_ba)
    except ParameterError:
        return math.nan
