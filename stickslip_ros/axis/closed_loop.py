# SPDX-License-Identifier: Apache-2.0
"""The closed loop: to a position or along a trajectory, by the readings of the sensor.

Coarse: steps until the target lies within the range of the actuator; their number follows from the
last measured step size, and the last step has a smaller amplitude. Fine: the level of the actuator
is moved by the error, then the position is read again. Moving and reading alternate, so neither
latency nor a moving runner makes the loop oscillate. Everything happens at the times of readings.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Sequence

from stickslip_ros.axis import state_machine
from stickslip_ros.axis.actuation import ANY, Actuation
from stickslip_ros.parameters import ParameterError

#: Readings that are averaged on the last stretch: their noise is a third of that of one
_AVERAGED = 10
#: Steps at most before the step size is known: few enough to pass no near target by far
_FIRST_STEPS = 10
#: Share of the predicted steps that is run when there are more than that: the rest corrects
_CAUTION = 0.9
#: Ways that the steps of one block may come to if none of the stroke is lost
_FARTHEST = 2.0
#: Step size at least assumed, of the stroke: blocks end although hardly a step was seen
_SMALLEST = 0.05
#: Strokes away from the target beyond what the steps since the last look can do: something else has
#: carried the runner, for steps take it a stroke each at most
_CARRIED = 10.0
#: Of these ways between two looks: steps that run backwards have taken it away
_LOST = 10.0
#: s, how far ahead of time a trajectory is stepped along: what one look of the supervisor covers
_LOOKAHEAD = 0.01
#: Steps that a block along a trajectory needs to show the step size beside ringing and noise
_LEARN_FROM = 3
#: Share of the range of a scan, at most, that is kept for corrections of a target
_MARGIN = 0.03
#: Looks for a place that leaves this margin: a second one would hardly find a better one
_BETTER_PLACES = 1
#: Points of a trajectory: a message of them stays below a megabyte
MOST_POINTS = 10_000
Point = tuple[float, float]  #: time since the start (s), measured position (m)


class StepSize:
    """Difference between stroke and step, measured for each direction."""

    def __init__(self) -> None:
        """Start without any measured step."""
        self._lost: dict[int, float] = {}

    def known(self, sign: int) -> bool:
        """Return whether a step in that direction was ever measured."""
        return sign in self._lost

    def lost(self, sign: int) -> float:
        """Return the part of the stroke that is lost, m; none before it is known."""
        return self._lost.get(sign, 0.0)

    def of(self, stroke: float, sign: int) -> float:
        """Return the step size (m) to expect of a stroke (m)."""
        return max(stroke - self.lost(sign), _SMALLEST * stroke)

    def learn(self, stroke: float, sign: int, step: float) -> None:
        """Take a measured step size (m, along the step)."""
        self._lost[sign] = stroke - step


class Trajectory:
    """The wanted position over time; before the first point, the way to it."""

    def __init__(self, start: float, x: float, points: Sequence[Point], wait: float = 0.0) -> None:
        """Begin at time start (s) and position x (m); the times of the points count from there.

        For a time of wait (s) nothing moves.
        """
        self.begin = start + wait  #: time until which nothing moves, s
        points = [(wait, x), *points] if wait else points
        self._times = [start, *(start + t for t, _ in points)]
        self._positions = [x, *(position for _, position in points)]
        self.start = start  #: s
        self.end = self._times[-1]  #: time of the last point, s
        self.goal = self._positions[-1]  #: position of the last point, m

    def at(self, t: float) -> float:
        """Return the position (m) at time t (s)."""
        k = bisect_right(self._times, t)
        if k == len(self._times):
            return self.goal
        t0, t1 = self._times[k - 1 : k + 1]
        x0, x1 = self._positions[k - 1 : k + 1]
        return x0 + (x1 - x0) * (t - t0) / (t1 - t0)

    def velocity_at(self, t: float) -> tuple[float, float]:
        """Return the velocity (m/s) at time t (s) and how long (s) until it changes."""
        k = bisect_right(self._times, t)
        if k == len(self._times):
            return 0.0, math.inf
        t0, t1 = self._times[k - 1 : k + 1]
        x0, x1 = self._positions[k - 1 : k + 1]
        return (x1 - x0) / (t1 - t0), t1 - t


def check_trajectory(
    joints: Sequence[str],
    points: Sequence[Point],
    joint: str,
    check_target: Callable[[float], None],
) -> list[Point]:
    """Return the points of a trajectory of the one joint; ParameterError if it is malformed."""
    if list(joints) != [joint]:
        raise ParameterError(f"trajectory for {', '.join(joints) or 'no joint'}; give {joint} only")
    if len(points) > MOST_POINTS:
        raise ParameterError(
            f"trajectory of {len(points)} points; {MOST_POINTS} is the limit: send it in parts, or "
            "leave points out; the axis moves straight between points"
        )
    if not points:
        raise ParameterError("trajectory without points; give at least one point")
    checked: list[Point] = []
    for number, point in enumerate(points, 1):
        if len(point) != 2:
            raise ParameterError(f"point {number} is {point!r}; give a time and a position")
        t, x = float(point[0]), float(point[1])
        before = checked[-1][0] if checked else 0.0
        if not (math.isfinite(t) and math.isfinite(x)):
            raise ParameterError(f"point {number} is ({t:g} s, {x:g} m); give finite numbers")
        if t < before or (checked and t == before):
            raise ParameterError(
                f"point {number} is at {t:g} s, not after {before:g} s: times have to increase"
            )
        try:
            check_target(x)
        except ParameterError as error:
            raise ParameterError(f"point {number}: {error}") from None
        checked.append((t, x))
    return checked


class ClosedLoop:
    """The task to follow a trajectory and to hold its end."""

    def __init__(
        self, name: str, trajectory: Trajectory, steps: StepSize, note: Callable[..., None]
    ) -> None:
        """Follow a trajectory; name is "target" or "trajectory", noted when the end is reached."""
        self._name = name
        self.trajectory = trajectory
        self._steps = steps
        self._note = note
        self.due = math.inf
        self.there = False  #: within the tolerance for the hold time, and still
        self.waits = False  #: for others before it says so; the motion is that without them
        self._finished = False
        self._x = math.nan  # last mean reading, m
        self._inside_since: float | None = None
        self._nearest = math.inf  # distance from the goal since it was left or set, m
        self._nearer_at = 0.0  # when it last became less, s
        self._looked = (0.0, math.inf)  # time (s) and distance (m) of the last check
        self._carried = False  # away from the goal, and no nearer since
        self._better_places = 0  # how often another one to reach the goal from was looked for
        self._k = 0  # number of the next reading, or of the one at which to decide
        self._to_read = 0
        self._read = 0
        self._sum = 0.0
        self._block: tuple[int, float, float] | None = None  # steps run, stroke, position before
        self._stepped_until = -math.inf  # s, as far as the trajectory was looked ahead

    @property
    def state(self) -> str:
        """Targeting, or holding while the position stays within the tolerance of the end."""
        return state_machine.HOLDING if self.reached else state_machine.TARGETING

    @property
    def reached(self) -> bool:
        """Whether the end is reached, by the others as well if it waits for them."""
        return self.there and not self.waits

    def wait_no_more(self) -> None:
        """End without the others from now on."""
        self.waits = False
        if self._finished:
            self._note_end()

    def on_trajectory(self, t: float) -> bool:
        """Return whether the following error counts: along a trajectory, and when reached."""
        return t < self.trajectory.end or self._finished

    def follow(self, trajectory: Trajectory) -> None:
        """Take another trajectory from now on, without a pause."""
        self.trajectory = trajectory
        self.there = self.waits = self._finished = False
        self._inside_since = None
        self._better_places = 0
        self._nearest = math.inf

    def why_lost(self, x: float, actuation: Actuation) -> str:
        """Return why the goal will not be reached, empty if it still may be; x: reading (m).

        It has come no nearer for the timeout: by less than the tolerance does not count, or else
        noise would do. A runner that something has carried far away has the whole time again, once
        until it comes nearer; one that its steps take away, as those that run backwards do, is
        lost.
        """
        config, t = actuation.config, actuation.t
        p = config.parameters.closed_loop
        error = self.trajectory.goal - x
        distance = abs(error)
        (looked, before), self._looked = self._looked, (t, distance)
        steps = _CARRIED + (t - looked) * (actuation.hertz or config.frequency)
        far = steps * config.stroke(config.amplitude)
        if t < self.trajectory.end or self._inside_since is not None:
            self._nearest, self._nearer_at, self._carried = math.inf, t, False
        elif distance - before > far:
            self._nearest, self._nearer_at = distance, self._nearer_at if self._carried else t
            self._carried = True
        elif distance < self._nearest - p.target_tolerance:
            self._nearest, self._nearer_at, self._carried = distance, t, False
        where = f"target {self.trajectory.goal:g} m: the runner is {error:g} m away and"
        if distance > self._nearest + _LOST * far:
            return f"{where} steps take it farther: change the load, the preload or the frequency"
        if p.target_timeout is not None and t - self._nearer_at > p.target_timeout:
            return (
                f"{where} has come no closer for {p.target_timeout:g} s: raise the amplitude, "
                "free the runner or raise target_timeout"
            )
        return ""

    def begin(self, actuation: Actuation) -> None:
        """Read where the runner is."""
        self._start_reading(actuation)

    def arrived(self, actuation: Actuation) -> bool:
        """Read where the runner is after a motion."""
        self._start_reading(actuation)
        return False

    def tick(self, actuation: Actuation) -> str:
        """Take a reading, or decide when the last one has arrived."""
        sensor = actuation.config.sensor
        if self._to_read:
            self._sum += actuation.config.reading(actuation.sensed, self._k)
            self._to_read -= 1
            self._k += 1 if self._to_read else sensor.delay
            self.due = sensor.time_of(self._k)
            if self._to_read or sensor.delay:
                return ""
        self.due = math.inf
        x = self._sum / self._read
        t = actuation.t
        if math.isnan(x):
            return "the sensor gives no reading: see to the sensor, then reset"
        self._learn(x, final=t >= self.trajectory.end)
        if t < self.trajectory.begin:
            self._start_reading(actuation)
            return ""
        if t < self.trajectory.end:
            self._follow(actuation, x, t)
            return ""
        return self._approach(actuation, x, t)

    # -- inside

    def _start_reading(self, actuation: Actuation) -> None:
        sensor, t = actuation.config.sensor, actuation.t
        t = max(t, self._stepped_until)
        final = t >= self.trajectory.end
        if final and self._block:
            t += actuation.config.parameters.closed_loop.settle_time
        self._k = sensor.number_at(t) + 1
        self._read = self._to_read = _AVERAGED if final else 1
        self._sum = 0.0
        self.due = sensor.time_of(self._k)

    def _learn(self, x: float, final: bool) -> None:
        if self._block:
            steps, stroke, before = self._block
            self._block = None
            sign = 1 if steps > 0 else -1
            if final or abs(steps) >= _LEARN_FROM:
                self._steps.learn(stroke, sign, sign * (x - before) / abs(steps))

    def _approach(self, actuation: Actuation, x: float, t: float) -> str:
        """Go to the end of the trajectory and stay there; x: mean reading (m)."""
        p = actuation.config.parameters.closed_loop
        error = self.trajectory.goal - x
        if abs(error) > p.target_tolerance:
            self._inside_since, self.there = None, False
        elif self._inside_since is None:
            self._inside_since = actuation.config.sensor.time_of(self._k) - self._time_read(
                actuation
            )
        if self._inside_since is not None and t - self._inside_since >= p.hold_time:
            self.there, self._x = True, x
            if not self._finished:
                self._finished = True
                if not self.waits:
                    self._note_end()
        held = actuation.travel.held * error > 0.0
        if held and abs(error) > p.target_tolerance:
            end = "high" if error > 0.0 else "low"
            return (
                f"target {self.trajectory.goal:g} m: the runner is held by the {end} end of travel"
            )
        gain, actuator = actuation.config.gain, actuation.config.parameters.actuator
        low, high = actuator.min_voltage * gain, actuator.max_voltage * gain
        level = actuation.level
        margin = min(3.0 * p.target_tolerance, _MARGIN * (high - low))
        reachable = low <= level + error <= high
        if reachable and not low + margin <= level + error <= high - margin:
            # Near an end of the range a target can be held against drift on one side only. Better
            # to come from another place; not for ever, and not once it is reached.
            self._better_places += 1
            reachable = self.there or self._better_places > _BETTER_PLACES
        # Out of reach of a scan a better place costs steps, which would leave the one it has.
        near = 0.5 * p.target_tolerance if reachable else p.target_tolerance
        if held or (abs(error) <= near and (reachable or self.there)):
            self._start_reading(actuation)
            return ""
        if reachable:
            actuation.scan_to(level + error)
        elif level:
            actuation.scan_to(0.0)
        else:
            self._step(actuation, error - 0.5 * (low + high), x)
        return ""

    def _note_end(self) -> None:
        self._note(self._name, "finished", target=self.trajectory.goal, position=self._x)

    def _time_read(self, actuation: Actuation) -> float:
        sensor = actuation.config.sensor
        return (self._read - 1 + sensor.delay) / sensor.rate

    def _step(self, actuation: Actuation, way: float, x: float) -> None:
        """Step by about a way (m); x: mean reading (m)."""
        sign = 1 if way > 0.0 else -1
        volts = actuation.config.amplitude
        stroke = actuation.config.stroke(volts)
        count = int(abs(way) / self._steps.of(stroke, sign))
        if not self._steps.known(sign):
            count = min(count, _FIRST_STEPS)
        elif count > _FIRST_STEPS:
            # steps lost to a load that has gone may not throw the runner far beyond
            count = int(min(_CAUTION * count, _FIRST_STEPS + _FARTHEST * abs(way) / stroke))
        if count == 0:
            count = 1
            stroke = min(abs(way) + self._steps.lost(sign), stroke)
            volts = actuation.config.nearest(actuation.config.actuator.volts_for(stroke)) or volts
        self._block = (sign * count, stroke, x)
        actuation.step(sign * count, volts)

    def _follow(self, actuation: Actuation, x: float, t: float) -> None:
        """Step along the trajectory; x: reading (m)."""
        if actuation.level:
            actuation.scan_to(0.0)
            return
        period = 1.0 / actuation.config.frequency
        lookahead = max(_LOOKAHEAD, period)
        ahead = self.trajectory.at(t + lookahead) - x
        sign = 1 if ahead > 0.0 else -1
        stroke = actuation.config.stroke(actuation.config.amplitude)
        count = min(
            round(abs(ahead) / self._steps.of(stroke, sign)),
            math.ceil(lookahead / period),
            ANY if self._steps.known(sign) else _FIRST_STEPS,
        )
        self._stepped_until = min(t + lookahead, self.trajectory.end)
        if count == 0:
            self._start_reading(actuation)
            return
        self._block = (sign * count, stroke, x)
        actuation.step(sign * count, actuation.config.amplitude)
