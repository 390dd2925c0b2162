# SPDX-License-Identifier: Apache-2.0
"""The closed loop: to a position or along a trajectory, by the readings of the sensor.

What the loop follows is the base, the position that the runner has with the actuator at level 0: a
reading less the commanded deflection. Only steps change it, by the stroke less what is lost of it.
So readings count on the way as well, what has happened since the last one is known, and one train
of steps follows the next without a pause. The last train has a smaller amplitude, so that it ends
where the rest is a short scan. Everything happens at the times of readings, or where a motion ends.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from stickslip_ros.axis.actuation import CYCLES, ENDLESS, RAMP, Actuation
from stickslip_ros.axis.command import HOLDING, HOMING, TARGETING
from stickslip_ros.axis.trajectory import Trajectory
from stickslip_ros.physics.laws.law import Contact

#: Last readings at rest that are averaged: their noise is a third of that of one
_AVERAGED = 10
#: Steps at most before the step size is known, unless no reading would see them: few enough to
#: pass no near target by far
_FIRST_STEPS = 10
#: Step size at least assumed, of the stroke: trains end although hardly a step was seen
_SMALLEST = 0.01
#: m, what the runner may ring by when it is read
_STILL = 1e-9
_NEVER = 2**62  # no number of a reading


class StepSize:
    """Difference between stroke and step, measured for each direction."""

    def __init__(self, expected: float) -> None:
        """Start without any measured step, with the loss (m) that is expected of one."""
        self.expected = expected  #: loss of a step (m) before one is measured
        self.measured: dict[int, float] = {}  #: loss of a step (m) by its direction
        self.steps: dict[int, int] = {}  #: from how many steps, at most, that was measured

    def lost(self, sign: int) -> float:
        """Return the part of the stroke that is lost, m."""
        return self.measured.get(sign, self.measured.get(-sign, self.expected))

    @property
    def ringing(self) -> float:
        """How far (m) the runner rings after a step: what friction holds back of the stroke."""
        return max([self.expected, *map(abs, self.measured.values())])

    def of(self, stroke: float, sign: int) -> float:
        """Return the step size (m) to expect of a stroke (m)."""
        return max(stroke - self.lost(sign), _SMALLEST * stroke)


def expected_loss(contact: Contact) -> float:
    """Return what a step of a contact loses of its stroke (m): a0 of docs/prediction.md, in short.

    A law without a breakaway distance winds up to the limit of its deflection.
    """
    return contact.z_ba + 0.67 * math.sqrt(contact.z_ba * contact.z_k) or contact.z_k


class LoopReading(NamedTuple):
    """A reading of the sensor, and what had been commanded by then."""

    k: int  #: number of the reading
    base: float  #: position (m) less the commanded deflection
    deflected: float  #: the commanded deflection, m
    steps: int  #: finished, with sign
    strokes: float  #: that these steps come to, m, with sign
    rests: bool  #: the runner, after these steps


class ClosedLoop:
    """The task to follow a trajectory and to hold its end, or to end there if that is home."""

    def __init__(
        self, name: str, trajectory: Trajectory, steps: StepSize, note: Callable[..., None]
    ) -> None:
        """Follow a trajectory; name is the event that is noted at its end, "home" of the way home.

        The others are "target" and "trajectory".
        """
        self._name, self._homes = name, name == "home"
        self._sizes = steps
        self._note = note
        self.due = math.inf
        self._x = math.nan  # where it was reached, by the mean of the last readings, m
        self._nearer_at = 0.0  # when the distance from the goal last became less, s
        self._coming: deque[LoopReading] = deque()  # readings that have not arrived
        # the last reading, with the mean base of those in the window: at rest, since the last step
        self._seen = LoopReading(0, math.nan, 0.0, 0, 0.0, False)
        self._window: deque[LoopReading] = deque(maxlen=_AVERAGED)
        self._reference = self._seen  # the one since which steps show their size
        self._take = self._k = 0  # numbers of the next reading, and of that at which one arrives
        self._steps, self._strokes = 0, 0.0  # of all trains that have ended, as of a reading
        self._stroke = 0.0  # of the train under way, m, with sign; 0 without one
        self._level = 0.0  # that a scan goes to, m
        self._rests_at = -math.inf  # s, when the runner has stopped ringing
        self._stepped_until = -math.inf  # s, as far as the trajectory was looked ahead
        self.follow(trajectory)

    @property
    def state(self) -> str:
        """Targeting, or holding while the position stays within the tolerance of the end."""
        return HOMING if self._homes else HOLDING if self.reached else TARGETING

    @property
    def reached(self) -> bool:
        """Whether the end is reached, by the others as well if it waits for them."""
        return self.there and not self.waits

    def wait_no_more(self) -> None:
        """End without the others from now on."""
        self.waits = False
        if self._finished:
            self._note_end()

    def follow(self, trajectory: Trajectory) -> None:
        """Take another trajectory from now on, without a pause."""
        self.trajectory = trajectory
        self.there = False  #: within the tolerance for the hold time, and still
        self.waits = False  #: for others before it says so; the motion is that without them
        self._finished = False
        self._inside_since = math.inf  # s, within the tolerance of the goal; inf if it is not
        self._direction = 0  # of the last train towards the goal
        self._nearest = math.inf  # distance from the goal since it was left or set, m
        self._looked = (0.0, math.inf)  # time (s) and distance (m) of the last check
        self._carried = False  # away from the goal, since it was left or set
        self._moves_away = False  # the same in each look since that

    def _expire(self, t: float) -> None:
        """Stay where the runner is, if the time of the trajectory is over before it is there."""
        if t >= self.trajectory.expires and not self._finished:
            self.follow(Trajectory(t, self._seen.base if self._stroke else self._base(), []))

    def why_lost(self, actuation: Actuation) -> str:
        """Return why the goal will not be reached, empty if it still may be.

        It has come no nearer for the timeout: by less than the tolerance does not count, or else
        noise would do, nor does a place within the tolerance where it does not stay. A runner that
        something has carried far away has the whole time again, once until it is there; one that
        its steps take away, as those that run backwards do, is lost.
        """
        config, t = actuation.config, actuation.t
        p, limit = config.parameters.closed_loop, config.parameters.limits.max_following_error
        x = config.reading(actuation.sensed, config.sensor.number_at(t))
        error = self.trajectory.at(t) - x
        follows = t < self.trajectory.end or self._finished
        if limit is not None and follows and abs(error) > limit:
            return f"following error is {error:g} m, the limit is {limit:g} m"
        distance = abs(self.trajectory.goal - x)
        (looked, before), self._looked = self._looked, (t, distance)
        # A step takes it a stroke at most: ten more than its steps, and something else moves it.
        steps = 10.0 + (t - looked) * (actuation.hertz or config.frequency)
        far = steps * config.stroke(config.amplitude)
        self._moves_away = distance - before > far and (self._moves_away or not self._carried)
        if t < self.trajectory.end or self.there:
            self._nearest, self._nearer_at, self._carried = math.inf, t, False
        elif self._moves_away:
            self._nearest, self._nearer_at = distance, self._nearer_at if self._carried else t
            self._carried = True
        elif distance < self._nearest - p.target_tolerance:
            self._nearest, self._nearer_at = distance, t
        goal, away = 1e6 * self.trajectory.goal, 1e6 * distance
        where = f"target {goal:g} um: the runner is {away:g} um away and"
        if distance > self._nearest + 10.0 * far:
            return f"{where} steps take it farther: change the load, the preload or the frequency"
        stays = self._inside_since < math.inf
        # Three trains may end farther from the goal, one to learn from included, and rest.
        waited = t - self._nearer_at - 3 * p.settle_time
        if p.target_timeout is not None and not stays and waited > p.target_timeout:
            near = min(distance, self._nearest) <= p.target_tolerance
            what = "not stayed so near" if near else "come no closer"
            return (
                f"{where} has {what} for {p.target_timeout:g} s: raise the amplitude, "
                "free the runner or raise target_timeout"
            )
        return ""

    def begin(self, actuation: Actuation) -> None:
        """Set out by the reading that has arrived last, as of a runner at rest; better ones follow.

        One that moves is seen again before anything is decided that takes a nanometre.
        """
        sensor, t = actuation.config.sensor, actuation.t
        now = sensor.number_at(t)
        self._seen = self._reference = self._read(actuation, max(now - sensor.delay, 0))
        if t >= self.trajectory.end and math.isfinite(self._seen.base):
            self._go(actuation)
        self._plan(actuation, now)

    def arrived(self, actuation: Actuation) -> bool:
        """Go on, after a train by what is known of where it ends."""
        t = actuation.t
        if self._homes and self.reached:
            return True
        if self._stroke:
            self._steps += actuation.steps_done
            self._strokes += abs(actuation.steps_done) * self._stroke
            self._stroke, self._rests_at = 0.0, t
            self._expire(t)
            if t >= self.trajectory.end:
                config, rests = actuation.config, _settling(actuation, self._sizes.ringing)
                self._rests_at += rests
                # Unless a reading at rest tells more before another step would end.
                if rests + (config.sensor.delay + 1) / config.sensor.rate > 1.0 / config.frequency:
                    self._go(actuation)
            elif t >= self._stepped_until:
                self._follow(actuation)
        self._plan(actuation, actuation.config.sensor.number_at(t))
        return False

    def tick(self, actuation: Actuation) -> str:
        """Take a reading, and decide by the one that arrives."""
        reason, delay = "", actuation.config.sensor.delay
        if self._k == self._take:
            self._coming.append(self._read(actuation, self._k))
        if self._coming and self._coming[0].k + delay <= self._k:
            reason = self._look(actuation, self._coming.popleft())
        self._plan(actuation, self._k)
        if self._homes and self.reached:
            self.due = math.inf
        return reason

    # -- inside: readings

    def _read(self, actuation: Actuation, k: int) -> LoopReading:
        deflected = actuation.deflected
        base = actuation.config.reading(actuation.sensed, k) - deflected
        done = actuation.steps_done if self._stroke else 0
        rests = actuation.kind != CYCLES and actuation.t >= self._rests_at
        strokes = self._strokes + abs(done) * self._stroke
        return LoopReading(k, base, deflected, self._steps + done, strokes, rests)

    def _plan(self, actuation: Actuation, k: int) -> None:
        """Set the next reading after number k: at rest each, on the way at half of what is left."""
        sensor, t = actuation.config.sensor, actuation.t
        self._take = max(k, sensor.number_at(self._rests_at) if self._rests_at > t else k) + 1
        if actuation.kind == CYCLES:
            end = actuation.due
            # Before the goal, even if no step loses anything from now on: a load may go.
            soon = abs(self.trajectory.goal - self._seen.base) / abs(self._stroke or 1.0)
            soon = t + (soon + _FIRST_STEPS) / (actuation.hertz or actuation.config.frequency)
            if self.trajectory.expires > t:
                soon = min(soon, self.trajectory.expires)
            self._take = max(k, sensor.number_at(min(0.5 * (t + end), soon))) + 1
            if sensor.time_of(self._take) > end:
                self._take = _NEVER
        # With a latency that has become shorter, some should have arrived before.
        arrives = max(self._coming[0].k + sensor.delay, k) if self._coming else _NEVER
        self._k = min(self._take, arrives)
        self.due = math.inf if self._k == _NEVER else max(sensor.time_of(self._k), t)

    def _look(self, actuation: Actuation, reading: LoopReading) -> str:
        """Learn from a reading that arrives, and go on if the runner rests."""
        seen, t = self._seen, actuation.t
        if math.isnan(reading.base):
            return "the sensor gives no reading: see to the sensor, then reset"
        low, high = _range(actuation)
        # A quarter of the range of a scan, and something has carried the runner away.
        if reading.steps != seen.steps or abs(reading.base - seen.base) >= 0.25 * (high - low):
            self._window.clear()
        if reading.rests:
            self._window.append(reading)
        bases = [one.base for one in self._window] or [reading.base]
        self._seen = reading._replace(base=math.fsum(bases) / len(bases))
        self._learn()
        if reading.rests:
            self._reference = self._seen
        self._expire(t)
        if self._stroke and t >= self.trajectory.end:
            # End a train that would take the base farther than a scan brings it back.
            sign, left = 1 if self._stroke > 0.0 else -1, actuation.steps_left
            ahead = abs(self._steps + actuation.steps_done + left - self._seen.steps)
            size = self._sizes.of(abs(self._stroke), sign)
            end = sign * (self._seen.base + sign * ahead * size - self.trajectory.goal)
            if end > (-low if sign > 0 else high):
                actuation.shorten()
        if self._stroke or t < self.trajectory.begin:
            return ""
        if t < self.trajectory.end:
            if t >= self._stepped_until:
                self._follow(actuation)
            return ""
        if reading.rests:
            return self._approach(actuation)
        # One that is too far for a scan, whatever it rings, steps on before it rests.
        level, rings = self.trajectory.goal - self._seen.base, self._sizes.ringing
        if reading.steps == self._steps and not low - rings < level < high + rings:
            self._go(actuation)
        return ""

    def _learn(self) -> None:
        """Take the step size from the steps between the reference and the last reading."""
        seen, before = self._seen, self._reference
        steps = seen.steps - before.steps
        if not steps or not (seen.rests or abs(steps) >= 3):  # they show it beside the ringing
            return
        stroke = (seen.strokes - before.strokes) / steps
        step = (seen.base - before.base) / steps
        if abs(step) <= 2.0 * stroke:
            sign = 1 if steps > 0 else -1
            self._sizes.measured[sign] = stroke - step
            self._sizes.steps[sign] = max(self._sizes.steps.get(sign, 0), abs(steps))
        else:  # something else has carried it
            self._reference = seen

    def _base(self) -> float:
        """Return the base (m) after all trains, by the steps since the last reading."""
        steps = self._steps - self._seen.steps
        lost = steps * self._sizes.lost(1 if steps > 0 else -1)
        return self._seen.base + self._strokes - self._seen.strokes - lost

    # -- inside: motion

    def _approach(self, actuation: Actuation) -> str:
        """Judge whether the goal is reached, and go nearer if not."""
        p, t = actuation.config.parameters.closed_loop, actuation.t
        error = self.trajectory.goal - (self._seen.base + actuation.level)
        if abs(error) > p.target_tolerance:
            self._inside_since, self.there = math.inf, False
        elif self._inside_since == math.inf:
            self._inside_since = actuation.config.sensor.time_of(self._seen.k)
        # The base is where it will be at this level; what was read tells where it was.
        read = math.fsum(one.base + one.deflected for one in self._window) / len(self._window)
        if (
            t - self._inside_since >= p.hold_time
            and len(self._window) == _AVERAGED
            and abs(self.trajectory.goal - read) <= p.target_tolerance
        ):
            self.there, self._x = True, read
            first, self._finished = not self._finished, True
            if first and not self.waits:
                self._note_end()
        if actuation.travel.held * error <= 0.0:
            self._go(actuation)
        elif abs(error) > p.target_tolerance:
            end = "high" if error > 0.0 else "low"
            goal = 1e6 * self.trajectory.goal
            return f"target {goal:g} um: the runner is held by the {end} end of travel"
        return ""

    def _go(self, actuation: Actuation) -> None:
        """Move towards the goal, as far as the place of the runner is known."""
        tolerance = actuation.config.parameters.closed_loop.target_tolerance
        low, high = _range(actuation)
        level = self.trajectory.goal - self._base()
        now = self._level if actuation.kind == RAMP else actuation.level
        reachable = low <= level <= high
        # Out of reach of a scan a better place costs steps, which would leave the one it has: where
        # it has been, only if that is surely off.
        doubt = actuation.config.sensor.noise / math.sqrt(max(len(self._window), 1))
        kept = tolerance + 3.0 * doubt * self._finished
        if abs(level - now) <= (0.5 * tolerance if reachable else kept):
            return
        seen = self._seen.steps == self._steps
        rested = seen and self._seen.rests and actuation.t >= self._rests_at
        if reachable:
            if rested:
                self._scan(actuation, level)
            return
        # A landing is known by a step; a scan to it takes no longer than the rest after steps, and
        # it leaves some tolerances for corrections.
        config, sign = actuation.config, 1 if level > now else -1
        p = config.parameters
        scan = p.drive.scan_rate * config.gain * p.closed_loop.settle_time
        step = self._sizes.of(config.stroke(config.amplitude), sign)
        room = min(max(min(step, scan), 6.0 * tolerance), 0.5 * (high - low))
        way = level - min(max(0.0, low + room), high - room)
        # To turn back takes a reading at rest: corrections of a runner that rings never end.
        if (seen or sign in self._sizes.measured) and (sign * self._direction >= 0 or rested):
            self._step(actuation, way)

    def _scan(self, actuation: Actuation, level: float) -> None:
        """Scan to a level (m), so that the runner rests soonest.

        The kinks of a speed v make it ring by v / omega each, by the way at most. A whole number
        of its periods apart they cancel, but for what the ringing has faded by meanwhile, and for
        what the contact bends: the share v / omega of its distance, which is kept to a nanometre.
        """
        config, way = actuation.config, abs(level - actuation.level)
        hertz, fading = config.plant().ringing_frequency, _settling(actuation, math.e * _STILL)
        omega, speed = 2.0 * math.pi * hertz, config.parameters.drive.scan_rate * config.gain
        rings = min(way, 2.0 * speed / omega) if omega else way
        rests = way / speed + _settling(actuation, rings)
        if omega and rings > _STILL:
            bends = max(self._sizes.expected, _STILL)
            slowest = math.sqrt(_STILL * bends) * omega
            even = math.ceil(max(way / speed, way / slowest) * hertz) / hertz
            kink = way / even / omega
            left = kink * (kink / bends - math.expm1(-even / fading)) if fading else kink
            if even + _settling(actuation, left) < rests:
                speed, rests = way / even, even + _settling(actuation, left)
        if not omega or 2.0 * speed / omega > _STILL:  # others are read on the way
            self._rests_at = max(self._rests_at, actuation.t + rests)
        self._level = level
        actuation.scan_to(level, speed)

    def _step(self, actuation: Actuation, way: float) -> None:
        """Step by about a way (m), in a train of equal steps."""
        sign = 1 if way > 0.0 else -1
        config, sensor = actuation.config, actuation.config.sensor
        volts = config.amplitude
        stroke, lost = config.stroke(volts), self._sizes.lost(sign)
        size, way = self._sizes.of(stroke, sign), abs(way)
        count = math.ceil(way / size)
        if count > _FIRST_STEPS:
            # The steps of a runner that rings on from one to the next get longer or shorter with
            # their number: a few times those that have shown their size, and the rest corrects.
            most = 4 * self._sizes.steps.get(sign, math.ceil(way / stroke))
            count = min(int(0.9 * count), max(most, _FIRST_STEPS))
            if sign not in self._sizes.measured:  # so many that a reading sees them
                seen = math.ceil(config.frequency * (sensor.delay + 2) / sensor.rate)
                count = min(count, max(_FIRST_STEPS, seen))
        else:
            stroke = min(max(way / count + lost, _SMALLEST * stroke), stroke)
            volts = config.nearest(config.actuator.volts_for(stroke)) or volts
        self._begin_train(actuation, sign * count, volts)

    def _follow(self, actuation: Actuation) -> None:
        if actuation.level:
            actuation.scan_to(0.0)
            return
        config, t = actuation.config, actuation.t
        period = 1.0 / config.frequency
        lookahead = max(0.01, period)  # s, what one look of the supervisor covers
        ahead = self.trajectory.at(t + lookahead) - self._base()
        sign = 1 if ahead > 0.0 else -1
        count = min(
            round(abs(ahead) / self._sizes.of(config.stroke(config.amplitude), sign)),
            math.ceil(lookahead / period),
            ENDLESS if sign in self._sizes.measured else _FIRST_STEPS,
        )
        self._stepped_until = min(t + lookahead, self.trajectory.end)
        if count:
            self._reference = self._seen
            self._begin_train(actuation, sign * count, config.amplitude)

    def _begin_train(self, actuation: Actuation, steps: int, volts: float) -> None:
        """Run steps, with sign, of an amplitude (V)."""
        sign = 1 if steps > 0 else -1
        if sign * (self._seen.steps - self._reference.steps) < 0:  # they went the other way
            self._reference = self._seen
        self._inside_since = math.inf  # it does not stay
        self._stroke, self._direction = sign * actuation.config.stroke(volts), sign
        actuation.step(steps, volts)

    def _note_end(self) -> None:
        self._note(self._name, "finished", target=self.trajectory.goal, position=self._x)


def _settling(actuation: Actuation, rings: float) -> float:
    """Return the time (s) in which ringing of an amplitude (m) falls to _STILL.

    `settle_time` is that of the most that a step leaves, its stroke.
    """
    config = actuation.config
    most = max(config.stroke(config.amplitude) / _STILL, math.e)
    share = math.log(max(rings / _STILL, 1.0)) / math.log(most)
    return share * config.parameters.closed_loop.settle_time


def _range(actuation: Actuation) -> tuple[float, float]:
    """Return the lowest and the highest level (m)."""
    actuator, gain = actuation.config.parameters.actuator, actuation.config.gain
    return actuator.min_voltage * gain, actuator.max_voltage * gain
