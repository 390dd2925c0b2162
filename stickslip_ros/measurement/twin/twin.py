# SPDX-License-Identifier: Apache-2.0
"""The twin of an axis: takes commands and readings in the order of time, and says what it knows.

The same calls in the same order give the same numbers, in a node as from a file.
"""

from __future__ import annotations

import copy
import math
from collections import Counter, deque
from contextlib import suppress
from dataclasses import dataclass
from typing import NamedTuple

from stickslip_ros.base.reporting import CONFIDENCE, format_si
from stickslip_ros.measurement.identification.posterior import Posterior
from stickslip_ros.measurement.twin.changes import (
    CAUSES,
    Attribution,
    ChangeDetector,
    Pieces,
    attribute,
)
from stickslip_ros.measurement.twin.settings import TwinError, TwinSettings
from stickslip_ros.measurement.twin.step_regression import MISFIT, StepRegression
from stickslip_ros.measurement.twin.timeline import (
    RESTED,
    OperatingPoint,
    Timeline,
    TwinCommand,
)
from stickslip_ros.measurement.twin.tracker import GLITCH, RATE, THETA, ProcessedReading, Tracker
from stickslip_ros.physics.model import Plant
from stickslip_ros.physics.model.waveforms import drive_of
from stickslip_ros.physics.parameters import PARAMETERS, ParameterError, Parameters

OK, DRIFTING, CHANGED, UNLIKE, BLIND = "ok", "drifting", "changed", "unlike the model", "blind"
#: Readings that are kept for the onset of a change; those after it that do not count, as it is
#: known no better, and the position may have jumped with it
_KEPT, _UNSURE = 4000, 10
#: s of disorder after a gap, an old reading or a motion at rest, unless the axis is seen at rest:
#: who loses readings or their order may have lost commands, or the clock. A glitch is no evidence
#: then, and a deviation no change: the axis is astray until it rests
_DOUBT = 60.0
#: Standard deviations of two readings within which an axis is at rest
_STILL = 7.0
#: Jump in ways between two readings from which on it is no change of the steps
_WAYS = 3.0
#: Factor between the numbers of readings at which a change is judged again
_AGAIN = 4
#: s of readings between pieces of a judgement, each of which takes some milliseconds
_PACE = 0.01
#: Deviation of the logarithm of the preload after a change that is not explained
_REOPENED = 0.3
#: s between the entries of the history, and their number, from which every second is dropped
_PERIOD, _MOST = 1.0, 4000
#: Standard deviations by which the step of the model differs from it
_DIFFERS = 4.0
#: Fraction of its deviation beforehand below which a parameter counts as seen
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
    """A change that was reported."""

    told: float  #: s
    onset: float  #: s, the likeliest
    step_before: float  #: m
    step_after: float  #: m, as known now
    drive: OperatingPoint  #: of these steps
    at_start: bool  #: whether the first steps already were other ones than the file says
    verdict: Attribution | None = None  #: None until there are readings enough
    goes_on: bool = False  #: whether it still went on then, so that no cause is judged
    modelled: float | None = None  #: m, step of the model then, where it is another one

    @property
    def text(self) -> str:
        """The change for people."""
        sizes = " to ".join(format_si(one, "m", 5) for one in (self.step_before, self.step_after))
        when = "from the start, so the file is not of this axis as it is"
        text = f"step {sizes}, {when if self.at_start else f'since {self.onset:.6g} s'}"
        waits = "not judged, as it goes on" if self.goes_on else "not judged yet"
        cause = self.verdict.text if self.verdict else waits
        if self.modelled is not None:
            cause += f"; the model steps {format_si(self.modelled, 'm', 5)} then"
        return f"{text} (reported at {self.told:.6g} s); cause: {cause}"


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
        posterior: Posterior | None = None,
    ) -> None:
        """Start from the parameters of the axis and, if there is one, what their fit knows."""
        self.settings = settings or TwinSettings()
        self.tracker = Tracker(p, self.settings, posterior)
        self.timeline = Timeline(p.drive.amplitude, p.drive.frequency)
        self.detector = ChangeDetector(self.settings.false_alarm_interval)
        self.changes: list[Change] = []
        #: Times (s), estimates, and drives without what was before
        self.history: list[tuple[float, list[TrackedParameter], tuple[float, ...]]] = []
        self.troubles: Counter[str] = Counter()  #: gaps, doubled readings and the like, by name
        self.t = math.nan  #: of the last reading, s
        self.driven = 0.0  #: s of stepping seen
        self._anchored = math.nan  # when the position was taken anew, s
        self._lost = False  # whether it has to be: nobody knows where the axis has gone
        self._old = math.inf, math.inf  # first and last time (s) of old readings in a row
        self._doubtful = -math.inf  # s, until when there is disorder
        self._jumped = -math.inf  # s, when the position jumped last
        self._astray = False  # whether its cycles are not known, until it rests
        self._still = math.nan, math.nan  # since when (s) and where (m) it has not moved
        self._steady = -math.inf  # since when nothing was reported, s
        self._begun = math.nan  # time of the first reading that showed cycles, s
        self._excited = -math.inf  # time of the last reading that showed cycles, s
        self._judging: Pieces[None] | None = None
        self._go_on_at = 0.0  # s, when the next piece of the judgement is due
        #: Each with what was known before it
        self._seen: deque[tuple[ProcessedReading, Tracker]] = deque(maxlen=_KEPT)
        self._judge_at = 0  # readings since the last change at which it is judged
        self._drives: set[tuple[float, float, int]] = set()  # of the steps it was judged by
        self._since = 0  # readings since the last change, of steps before the first
        self._excess = 0.0  # of the squares of deviations after it over what they should be
        self._before = self.tracker  # the last change
        self._drive: OperatingPoint | None = None  # of the last cycles
        self._regression: StepRegression | None = None  # since the last change

    # -- taking

    def command(self, command: TwinCommand) -> None:
        """Take a command; they come in the order of time, each before later readings."""
        name, t, value, now = command.name, command.t, command.value, self.timeline
        if not (math.isfinite(t) and math.isfinite(value)):
            self.troubles["commands that are no numbers"] += 1
            return
        drive = {"amplitude": now.amplitude, "frequency": now.frequency}
        if name in drive or (name == "jog" and value):
            drive["frequency" if name == "jog" else name] = abs(value) if name == "jog" else value
        try:
            drive_of(self.tracker.model.p.replace(**drive))
        except ParameterError:
            self.troubles["commands that no axis like this carries out"] += 1
            return
        if name == "start" and t >= self._anchored:  # an older one is history
            self.troubles["restarts of the axis"] += 1
            self.t = math.nan
        elif t < self.t:  # takes back what readings have done since
            self._lost = True
            if t >= self._anchored:  # else it is of an axis that ran before the twin
                self.troubles["late commands"] += 1
                self.detector.reset()
                if self._regression:
                    self._regression.forget()
                if self.changes and self.changes[-1].told >= t and not self.changes[-1].verdict:
                    del self.changes[-1]
                    self._regression = self._judging = None
                known = (one for seen, one in self._seen if seen.t > max(t, self._steady))
                self.tracker = next(known, self.tracker)
        self._still = t, self._still[1]
        now.add(command)

    def measure(self, t: float, reading: float) -> Update | None:
        """Take a reading (m) with its time stamp (s); None if it is of no use by itself."""
        t -= self.settings.latency
        if not (math.isfinite(t) and math.isfinite(reading)):
            self.troubles["readings that are no numbers"] += 1
            return None
        if t <= self.t and not self._clock_jumped(t):
            return None
        duration, self._old = t - self.t, (math.inf, math.inf)
        if duration > self.settings.longest_gap:
            self.troubles["gaps"] += 1
            self._lost, self._doubtful, self._still = True, t + _DOUBT, (t, reading)
        elif self._astray or self.timeline.blind_between(self.t, t):
            self.troubles["readings during unknown cycles"] += 1
            self._lost = True
        if not abs(reading - self._still[1]) < _STILL * self.settings.noise:
            self._still = t, reading
        drives = (one for one in (self._drive, self.timeline) if one)
        cycle = 1.0 / min(one.frequency for one in drives)
        if t <= self._doubtful and t - self._still[0] > cycle + RESTED:
            self._doubtful, self._astray = -math.inf, False
            if self.timeline.pieces and self.timeline.pieces[-1].end > t:
                self.timeline.clear()
                self._lost = True
        if self._lost or math.isnan(self.t):
            self._anchor(t, reading)
            return None
        return self._update(t, reading, duration)

    def _clock_jumped(self, t: float) -> bool:
        """Take an old reading; return whether there were only such for so long that it is none."""
        first, last = self._old
        goes_on = last <= t < last + 0.5 * self.settings.longest_gap
        self._old = first if goes_on else t, t
        if t - self._old[0] > self.settings.longest_gap:
            self.troubles["jumps of the clock"] += 1
            self.timeline.clear()
            self._astray, self._doubtful, self._still = True, t + _DOUBT, (t, math.nan)
            self.t = self._excited = math.nan
            self._jumped = -math.inf
            return True
        self.troubles["doubled readings" if t == self.t else "late readings"] += 1
        self._doubtful = self.t + _DOUBT
        return False

    def _anchor(self, t: float, reading: float) -> None:
        """Take the position anew: what the axis did since the last reading is not known."""
        self.tracker = copy.copy(self.tracker)
        running = list(self.timeline.between(t - 1e-6, t))
        self.tracker.anchor(reading, self.tracker.motion(running).blur)
        self.timeline.forget(t)
        self._seen.clear()
        self._lost = False
        if self._regression:
            self._regression.interrupt()
        self.t = self._anchored = t

    def _update(self, t: float, reading: float, duration: float) -> Update:
        tracker, before = self.tracker, copy.copy(self.tracker)
        parts = list(self.timeline.between(self.t, t))
        motion = tracker.motion(parts)
        if motion.direction:
            drive = next(p.drive for p, _, _ in reversed(parts) if p.drive)
            if self._drive and self._drive[:2] != drive[:2]:
                tracker.forget(RATE, RATE + 1)  # every other cause would look like a rate there
            self._drive = drive
        seen = ProcessedReading(t, reading, parts, motion)
        expected, deviation, z = tracker.update(seen, duration)
        self._seen.append((seen, before))
        if self._regression:
            self._regression.take(seen)
        self._since += bool(self.changes or motion.direction)
        judged = self._since == self.settings.judged_from and not self._drifts
        if (judged or tracker.jumped or t <= self._doubtful) and not self.changes:
            tracker.hold_rate()  # it was open, as the axis may have come with one
        self.t = t
        self.timeline.forget(t)
        self._excess += z**2 - 1.0
        if tracker.jumped:
            self.troubles["jumps of the position"] += 1
            # Steps of another size add up to a deviation as well, but not to a few steps at once.
            step = abs(tracker.step_size(self._drive)[0]) if self._drive else 0.0
            way = (step + abs(motion.distance)) if motion.direction else 0.0
            if abs(reading - expected) > _WAYS * way:
                self._jumped = t
            self._doubtful = self._doubtful if motion.direction else t + _DOUBT
        changed = False
        if motion.direction:
            if not self.driven:
                self._begun = t
            self.driven += duration
            self._excited = t if abs(z) < GLITCH else self._excited
            if (t > self._doubtful or abs(z) < GLITCH) and not self._pending:
                changed = self.detector.update(t, duration, motion.direction * z)
        if changed and t <= self._doubtful:
            self.troubles["deviations in disorder"] += 1
            onset, self._astray, changed = self.detector.onset, True, False
            self.tracker = next((known for one, known in self._seen if one.t > onset), tracker)
            self.detector.reset()
        elif changed:
            self._change(seen)
        self._continue_judging()
        if self.changes and self._since <= _KEPT:
            change = self.changes[-1]
            change.step_after, error = self.step_size(change.drive)
            model, own = self.tracker.step_size(change.drive)
            far = abs(change.step_after - model) > _DIFFERS * math.hypot(error, own)
            change.modelled = model if far else None
        due = not self.history or not 0.0 <= t - self.history[-1][0] < _PERIOD
        if due and self._drive is not None:
            self.history.append((t, self.estimates(), self._drive[:3]))
            if len(self.history) > _MOST:
                del self.history[::2]
        return Update(t, reading, expected, deviation, changed)

    # -- changes

    def _change(self, seen: ProcessedReading) -> None:
        """Tell a change, and let the estimates find what holds now."""
        # What makes the position jump came then, such as a sensor with another gain.
        onset, tracker = max(self.detector.onset, self._jumped), self.tracker
        self._before = next((known for one, known in self._seen if one.t > onset), tracker)
        assert self._drive
        step = self._before.step_size(self._drive)[0]
        # It was never seen to fit for longer than it was seen not to.
        at_start = not self.changes and onset - self._begun <= self.t - onset
        self.changes.append(Change(self.t, onset, step, step, self._drive, at_start))
        since = [one for one, _ in self._seen if one.t > onset] or [seen]
        self._since, place = len(since), since[0].reading
        way = since[-1].reading - place
        self._regression = StepRegression(self._before.model, self.settings, place, way)
        for one in since[_UNSURE:]:
            self._regression.take(one)
        self._judge_at, self._judging, self._excess = self.settings.judged_from, None, 0.0
        self._drives = set()
        tracker.reopen()
        tracker.anchor(seen.reading, seen.motion.blur)
        self.detector.reset()
        self._steady = self.t

    @property
    def _pending(self) -> bool:
        """Whether a change waits for a verdict: until then, one is reported at a time.

        Causes that were alike at the drives since then are not at a new one.
        """
        if not self.changes or self.changes[-1].goes_on:
            return False
        verdict = self.changes[-1].verdict
        judged = self._drive is not None and self._drive[:3] in self._drives
        return verdict is None or not (verdict.cause or judged)

    def _continue_judging(self) -> None:
        """Judge the last change, later and at each new drive once more: a piece now and then."""
        if self._regression and not self._judging and self._since >= self.settings.judged_from:
            now = self._drive and self._drive[:3]
            new = now not in self._drives and any(
                one.drive[:3] == now for one in self._regression.steps()
            )
            if new or 0 < self._judge_at <= self._since:
                while self._judge_at <= self._since:
                    self._judge_at *= _AGAIN
                self._judging = self._judge(self.changes[-1], self._regression)
                self._go_on_at = self.t
        if self._judging and self.t >= self._go_on_at:
            self._go_on_at = self.t + _PACE
            if next(self._judging, self) is self:
                self._judging = None

    def settle(self) -> None:
        """Judge the last change by what there is: no more readings come."""
        for _ in self._judging or ():
            pass
        self._judging = None
        if self._regression:
            for _ in self._judge(self.changes[-1], self._regression):
                pass

    def _judge(self, change: Change, regression: StepRegression) -> Pieces[None]:
        """Judge a change by the steps since."""
        change.goes_on, before = self._drifts, copy.copy(self._before)
        shown, fits = regression.steps(), regression.fits
        if shown and not change.goes_on:
            before.renew(-1.0)
            change.verdict = verdict = yield from attribute(before, shown, fits, self.settings)
            if verdict.explained:
                name = verdict.adopted
                p, of = verdict.after[name], CAUSES[name].parameter
                shown = regression.steps() or shown  # as known by now
                gain = before.sensor_gain * (1.0 if of else math.exp(verdict.sizes[name]))
                covariance = before.covariance[THETA, THETA]
                self.tracker = self.tracker.rebased(
                    p, of, gain, covariance, shown, not verdict.cause
                )
                if self._seen:  # else the position has just been taken anew
                    last, _ = self._seen[-1]
                    self.tracker.anchor(last.reading, last.motion.blur)
                self.detector.reset()
                self._steady = self.t
        self._drives = {one.drive[:3] for one in shown}

    # -- what is known

    @property
    def level(self) -> tuple[str, str]:
        """The level and its reason, for people."""
        settings = self.settings
        if math.isnan(self.t):
            return BLIND, "no position was heard"
        if self._astray:
            return BLIND, "after disorder the cycles are not known until the axis rests"
        if not self.t - self._excited <= settings.blind_after:
            return BLIND, f"no step was seen for {settings.blind_after:g} s; estimates are held"
        change = self.changes[-1] if self.changes else None
        verdict = next((one.verdict for one in reversed(self.changes) if one.verdict), None)
        if self.tracker.lost or (verdict and not verdict.explained):
            return UNLIKE, change.text if change else "the estimates leave the model's range"
        if self._drifts:
            return DRIFTING, f"the step changes by {360_000.0 * self.drift[0]:+.2g} % an hour"
        if change and self.t - change.told < settings.drift_window:
            return CHANGED, change.text
        return OK, "as expected"

    @property
    def departs(self) -> bool:
        """Whether the step drifts or the estimates have left the model, seen now or before."""
        return self.tracker.lost or self._drifts

    @property
    def _drifts(self) -> bool:
        rate, deviation = self.drift
        fits = self._excess <= MISFIT * math.sqrt(2.0 * max(self._since, 1))
        known = fits or (bool(self.changes) and self.changes[-1].goes_on)
        return bool(known and abs(rate) > self.settings.drift_errors * deviation)

    @property
    def drift(self) -> tuple[float, float]:
        """Rate of the step as a fraction of it, 1/s, and its standard error.

        It is that since a change while its cause is not known, else that over the last window.
        """
        if not self.history or self._drive is None:
            return 0.0, math.inf
        rate, error = self.tracker.drift(self._drive)
        if error > 0.0:
            return rate, error
        window, last = self.settings.drift_window, self.history[-1]
        first = max(last[0] - window, self._steady)
        # The step of another drive, or back, is another one without a drift.
        same = (one for one in self.history if one[2] == last[2] and one[0] > first)
        begin, then, _ = next(same, last)
        if (lasts := last[0] - begin) < 0.5 * window:
            return 0.0, math.inf
        old, new = then[-1], last[1][-1]  # the step is the last of the estimates
        if not old.value:
            return 0.0, math.inf
        scale = abs(old.value) * lasts
        width = math.hypot(new.high - new.low, old.high - old.low)
        return (new.value - old.value) / scale, 0.5 * width / (CONFIDENCE * scale)

    def step_size(self, drive: OperatingPoint) -> tuple[float, float]:
        """Return the step of a drive and its standard deviation, m.

        After a change that does not go on, it is what the readings since then show.
        """
        known = self._regression if self._regression and not self._drifts else None
        if known and (shown := known.step(drive)):
            return shown
        return self.tracker.step_size(drive)

    def estimates(self) -> list[TrackedParameter]:
        """Return the parameters, the breakaway distance and the step size with their intervals."""
        tracker, found = self.tracker, []
        verdict = self.changes[-1].verdict if self.changes else None
        known = verdict if verdict and verdict.explained else None
        others = [known.after[one] for one in known.possible] if known else []
        for k, name in enumerate(tracker.names):
            value, deviation = float(tracker.values[k]), float(tracker.deviations[k])
            if self.changes and not known and name == "preload":
                deviation = _REOPENED
            wide = math.exp(CONFIDENCE * deviation)
            # What the parameter is if the last change had another cause
            values = [value, *(float(p.value(name)) for p in others)]
            ends = min(values) / wide, max(values) * wide
            seen = not others and deviation < _SEEN * tracker.prior[k]
            found.append(TrackedParameter(name, PARAMETERS[name].unit, value, *ends, bool(seen)))
        preload, z_ba = next(one for one in found if one.name == "preload"), [math.nan] * 3
        for k, force in enumerate(preload[2:5]):
            with suppress(ParameterError):  # nan where the law does not know it
                z_ba[k] = Plant.of(tracker.model.p.replace(preload=force)).contact.z_ba
        found.append(
            TrackedParameter("breakaway distance", "m", z_ba[0], z_ba[1], z_ba[2], preload.seen)
        )
        if self._drive is not None:
            step, deviation = self.step_size(self._drive)
            half = CONFIDENCE * deviation
            found.append(TrackedParameter("step size", "m", step, step - half, step + half, True))
        return found

    # -- what comes

    def predict_steps(self, steps: int) -> Forecast:
        """Return where steps (sign: direction) end that begin as soon as the axis rests.

        Raises TwinError while the axis steps without end, or before there is a reading.
        """
        running = self.timeline.pieces[-1] if self.timeline.pieces else None
        if math.isnan(self.t):
            raise TwinError("there is no reading to predict from; give the position first")
        if self._astray:
            raise TwinError("the cycles are not known; let the axis rest, then ask")
        if running and math.isinf(running.end):
            does = "steps without end" if running.drive else "follows a closed loop"
            raise TwinError(f"the axis {does}; stop it, then ask for a prediction")
        begin = max(self.t, running.end) if running else self.t
        parts = list(self.timeline.between(self.t, begin))
        piece = self.timeline.piece(begin, 1 if steps >= 0 else -1, float(abs(steps)))
        if steps:
            parts.append((piece, begin, piece.end + RESTED))
        assert piece.drive
        then, model = copy.copy(self.tracker), self.tracker.step_size(piece.drive)
        step, deviation = self.step_size(piece.drive)
        shown = (step, deviation) != model  # by the readings since a change
        if shown:
            then.forget(RATE, RATE + 1)
        then.advance(then.motion(parts), piece.end + RESTED - self.t)
        x = then.x + abs(steps) * (step - model[0])
        variance = float(then.covariance[0, 0]) + (shown * steps * deviation) ** 2
        half = CONFIDENCE * math.sqrt(variance)
        return Forecast(steps, begin, piece.end, x, x - half, x + half)

    def predict_position(self, target: float) -> Forecast:
        """Return the steps that end nearest to a target (m), and where they end.

        Raises TwinError as `predict_steps`, and where the steps do not lead to the target.
        """
        distance = target - self.predict_steps(0).position
        direction = 1 if distance >= 0.0 else -1
        drive = self.timeline.piece(self.t, direction, 1.0).drive
        assert drive
        step, _ = self.step_size(drive)
        if not step * direction > 0.0:
            raise TwinError("the axis makes no steps in that direction; raise the amplitude")
        near = round(distance / step)
        return min(
            (self.predict_steps(direction * max(near + more, 0)) for more in (-1, 0, 1)),
            key=lambda found: abs(found.position - target),
        )
