# SPDX-License-Identifier: Apache-2.0
"""Moves the actuator of an axis: rest at a level, drive cycles, or a slow ramp of the level.

Cycles start from level 0. An actuator at another level first moves back to 0 at `scan_rate`. A
change of a running cycle takes effect at its end, but a cycle may be broken off: then the actuator
stays at the level that it has, and the cycle is no step.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from stickslip_ros.axis.config import Config
from stickslip_ros.axis.dc_offset import DcOffset
from stickslip_ros.axis.faults import Travel
from stickslip_ros.axis.sensor import Readings, Sensor, SensorDynamics, has_bandwidth
from stickslip_ros.physics.model import DriveCycle
from stickslip_ros.physics.model.actuator_chain import Chain
from stickslip_ros.physics.model.waveforms import voltage_of
from stickslip_ros.physics.solver import State
from stickslip_ros.physics.solver.driven import DrivenSimulation, simulation_of

REST, RAMP, CYCLES = "rest", "ramp", "cycles"
#: Reasons why a part of the motion ends, see `Actuation.arrive`
ARRIVED, CHANGE, LIMIT, GOES_ON = "arrived", "change", "limit", "goes on"

ENDLESS = 2**62  #: cycles that are as good as without end
#: Arcs that a cycle may take: a fraction of a second, for others wait for the axis meanwhile.
_BUDGET = 100_000
#: Readings up to which one after the other costs less than all at once
_FEW = 3
#: Time (s) that a stop waits for the end of a cycle; a longer rest of it is broken off.
SOON = 0.02
#: Cycles that are run in one go at most, for their results take memory: 40 bytes each
_MOST_CYCLES = 2**16


class Actuation:
    """Drives the simulation of one axis with the settings in ``config``."""

    def __init__(self, config: Config) -> None:
        """Start with the runner at rest at 0."""
        self.config = config
        p = config.parameters
        self._plant = config.plant()  # in force, without the external load
        self.sim = simulation_of(p, self._plant, budget=_BUDGET)
        self.travel = Travel(self.sim, p.limits)
        self.kind = REST
        self._dc_offset = DcOffset(config)
        self._ramp_end = 0.0  # deflection (m) at which the ramp ends
        self.load = 0.0  #: external force along the axis, N
        self.hertz: float | None = None  #: frequency of the cycles if not the commanded one
        self._volts: float | None = None  # likewise
        self._queued = 0  # steps that wait for the level to be 0
        self._sign = 1
        self._peak = 0.0  # voltage that the running cycles go to from 0
        self._drive = p.drive  # when they began
        self._cycles_start = 0.0  # s
        self._cycles_u = 0.0  # commanded deflection then, m
        self._check = ENDLESS  # cycle after which the soft limits are checked again
        # The cycle after which changes that wait take effect, and when it ends (s). Kept, because
        # the solver may round a time just before that end to it and be in the next cycle already.
        self._change: tuple[int, float] | None = None
        self._shortened = False  # the cycles end then
        self._x_start = 0.0  # where the present run began, m
        self._x_end = 0.0  # where the last run ended, before the runner rang down, m
        self._done_before = 0  # cycles of the present run before its drive cycle last changed
        self._count_before = 0  # net steps before the present run
        self._run_before = 0  # steps in both directions before it
        self._last = (math.nan, math.nan)  # displacement (m) and energy (J) of the last cycle
        self._sensor: Sensor | None = None  # that the dynamics belong to
        self._dynamics: SensorDynamics | None = None  # of a sensor with a bandwidth
        self._readings = Readings()  # under way
        #: s, of the next question: readings that are older by then are not taken
        self.asked = 0.0
        self._read_sensor()

    # -- requests

    @property
    def t(self) -> float:
        """Present time, s."""
        return self.sim.t

    @property
    def x(self) -> float:
        """Runner position, m."""
        return self.sim.x

    @property
    def sensed(self) -> float:
        """Position at the sensor (m), without noise: x, low-pass filtered if it has a bandwidth."""
        self._read_sensor()
        return self._dynamics.sensed if self._dynamics else self.x

    @property
    def arrived(self) -> tuple[int, float]:
        """Number of the reading that has arrived last, and the position (m) that it saw."""
        return self._readings.arrived(self.config.sensor, self.t)

    @property
    def level(self) -> float:
        """Level at which the actuator rests or its cycles start: gain times voltage, m."""
        return 0.0 if self.kind == CYCLES else self._dc_offset.at(self._commanded)

    @property
    def deflected(self) -> float:
        """Commanded deflection from level 0 (m), also within a cycle."""
        return self.sim.commanded - self._cycles_u if self.kind == CYCLES else self.level

    @property
    def steps_done(self) -> int:
        """Cycles of the present or last run, with sign."""
        running = self.sim.cycles_done if self.kind == CYCLES else 0
        return (self._done_before + running) * self._sign

    @property
    def steps_left(self) -> int:
        """Cycles of the present run that have not ended, with sign; 0 for one without end."""
        left = self.sim.cycles_left * self._sign if self.kind == CYCLES else self._queued
        return left if abs(left) < ENDLESS // 2 else 0

    @property
    def step_count(self) -> int:
        """Number of finished cycles, with sign."""
        return self._count_before + self.steps_done

    @property
    def cycles_run(self) -> int:
        """Number of finished cycles in both directions."""
        return self._run_before + abs(self.steps_done)

    @property
    def mean_step(self) -> float:
        """Mean displacement (m) over the cycles of the present or last run; nan without any."""
        done = abs(self.steps_done)
        x = self.sim.position_of_cycle if self.kind == CYCLES else self._x_end
        return (x - self._x_start) / done if done else math.nan

    @property
    def last_cycle(self) -> tuple[float, float]:
        """Displacement (m) over the last cycle and energy (J) lost in it; nan before the first."""
        if self.kind == CYCLES and self.sim.cycles_done:
            return self.sim.last_step, self.sim.last_lost
        return self._last

    # -- motion

    def step(self, steps: int, volts: float | None = None, hertz: float | None = None) -> None:
        """Run cycles, the sign is the direction; None: amplitude and frequency as commanded."""
        self._volts, self.hertz = volts, hertz
        self._count_before += self.steps_done
        self._run_before += abs(self.steps_done)
        self._done_before = 0
        self._sign = 1 if steps > 0 else -1
        if self.level:
            self._queued = steps
            self.scan_to(0.0)
        else:
            self._begin_cycles(steps)

    def scan_to(self, level: float, speed: float | None = None) -> None:
        """Move the actuator to a level (m) at a speed (m/s), None: that of `scan_rate`."""
        now = self._commanded
        speed = speed or self.config.parameters.drive.scan_rate * self.config.gain
        ramp = self._dc_offset.ramp_to(level, now, speed)
        self.kind = RAMP if ramp else REST
        if ramp:
            self._ramp_end = now.u + ramp.shift
            self.sim.start(ramp, 1)
        elif self._queued:
            self._begin_cycles(self._queued)

    def halt(self) -> None:
        """Leave the level where it is."""
        self.kind = REST
        self._dc_offset.stay(self.t)
        self.hertz = None
        self._queued = 0
        self.sim.start(self.sim.drive_cycle, 0)

    def change_later(self) -> None:
        """Apply changes when the running cycle ends, or at once if none runs."""
        if self.kind != CYCLES:
            self.apply_parameters()
        elif not self._change:
            more = bool(self.sim.cycles_left)
            ends = self.sim.end_of_cycle if more else self.sim.end_of_move
            self._change = self.sim.cycles_done + more, ends

    @property
    def stands(self) -> bool:
        """True while runner and actuator rest and stay as they are, as the sensor does."""
        return self.kind == REST and self.sim.stands and not self._dynamics

    @property
    def changes_at(self) -> float:
        """When (s) changes take effect that wait for the running cycle; nan if none does."""
        return self._change[1] if self._change else math.nan

    @property
    def cycle_ends(self) -> float:
        """When (s) the running cycle ends; now, if none runs."""
        return self.sim.end_of_cycle if self.kind == CYCLES and self.sim.cycles_left else self.t

    def break_off(self) -> None:
        """Stop at once, in the middle of a cycle as well; the actuator stays at its level."""
        volts = self._cycle_volts() if self.kind == CYCLES else []
        self._end_run()
        self.halt()
        self._dc_offset.moved(volts)
        self.apply_parameters()

    def shorten(self) -> None:
        """End the cycles with the running one."""
        self._shortened = True
        self.change_later()

    def apply_parameters(self) -> None:
        """Use plant and actuator of the present settings from now on."""
        self._plant = self.config.plant()
        self.set_load(self.load)
        aim = self._dc_offset.replace(self.config, self.level, self._commanded)
        if isinstance(self.sim, DrivenSimulation):
            self.sim.set_chain(Chain.of(self.config.parameters))
        if aim is not None and self.kind == RAMP:
            self.scan_to(aim)

    def drive_changed(self) -> None:
        """Apply another amplitude or frequency from the next cycle on."""
        if self.kind == CYCLES:
            self.change_later()

    def set_load(self, newtons: float) -> None:
        """Apply an external force (N) at once."""
        self.load = newtons
        self._expect_motion()
        plant = self._plant._replace(force=self._plant.force + newtons)
        self.sim.set_plant(plant, self.config.parameters.solver.tolerance)

    def faults_changed(self) -> None:
        """Let the faults on demand act from now on; a lost preload with the next cycle."""
        self.travel.confine(self.config.faults, self.config.offset, self.cycles_run)
        self._expect_motion()
        if self.kind == CYCLES:
            self._plan()

    # -- time

    def advance(self, t: float) -> None:
        """Advance to time t (s)."""
        self._watch(t)
        if t > self.sim.t:
            self.sim.advance(t)

    @property
    def due(self) -> float:
        """Time at which `arrive` has to be called next, s."""
        return math.inf if self.kind == REST else self._stretch()[1]

    def arrive(self) -> str:
        """Advance to the time due and return what ended there.

        ARRIVED: the ramp or the last cycle; CHANGE: the cycle after which changes take effect, the
        caller decides how to continue; LIMIT: the last cycle before a soft limit; GOES_ON: nothing.
        """
        cycle, end = self._stretch()
        self._watch(end)
        self.sim.run_cycles(max(cycle - self.sim.cycles_done, 0))
        if self.kind == RAMP:
            self.kind = REST
            self._dc_offset.arrive()
            if not self._queued:
                return ARRIVED
            self._begin_cycles(self._queued)
            return GOES_ON
        if self._change:
            self._change = None
            return CHANGE
        if not self.sim.cycles_left:
            return ARRIVED
        self._plan()
        return LIMIT if self._check == self.sim.cycles_done else GOES_ON

    def go_on(self) -> str:
        """Apply waiting changes and run the rest of the cycles; return ARRIVED or LIMIT."""
        left = 0 if self._shortened else self.sim.cycles_left
        if left:
            self._account_for_cycles()
        self.apply_parameters()
        if not left:
            return ARRIVED
        self._start_cycles(left)
        return LIMIT if self._check == 0 else GOES_ON

    def end_cycles(self) -> None:
        """Rest from the end of a cycle on; waiting changes take effect."""
        left = self.sim.cycles_left
        self._end_run()
        self.kind, self.hertz = REST, None
        if left:
            self.sim.start(self.sim.drive_cycle, 0)

    # -- soft limits

    def ends_beyond(self, seconds: float) -> str:
        """Return the soft limit that the ramp may pass within a time (s); empty if none."""
        drive_cycle = self.sim.drive_cycle
        distance = min(
            abs(self._ramp_end - self.sim.commanded), seconds * float(abs(drive_cycle.rates).max())
        )
        if distance <= self._room(drive_cycle.sign):
            return ""
        return "soft_high" if drive_cycle.sign > 0 else "soft_low"

    # -- inside

    @property
    def _commanded(self) -> State:
        """The present state with the commanded deflection in place of that of the actuator."""
        return replace(self.sim.state, u=self.sim.commanded)

    def _read_sensor(self) -> None:
        """Use the sensor of the present parameters from now on."""
        if self._sensor is self.config.sensor:
            return
        p, old, self._sensor = self.config.parameters.sensor, self._dynamics, self.config.sensor
        if not has_bandwidth(p):
            self._dynamics = None
        elif old is None or old.parameters != p:
            ringing = self._plant.ringing_frequency
            self._dynamics = SensorDynamics(p, ringing, self.t, self.x)

    def _expect_motion(self) -> None:
        """Look at every sample again, because something acts on the runner now."""
        if self._dynamics:
            self._dynamics.wake()

    def _watch(self, t: float) -> None:
        """Advance to the samples, up to time t (s), that the sensor needs."""
        self._read_sensor()
        sensor = self.config.sensor
        numbers = self._readings.due(sensor, t, max(t, self.asked))
        seen: list[float] = []
        if self._dynamics:
            for times in self._dynamics.due(t, self.kind != REST, numbers.start):
                samples = self.sim.sample(times)
                seen.extend(self._dynamics.record(samples.x, samples.v).tolist())
        elif len(numbers) > _FEW:
            seen = self.sim.sample(np.array([sensor.time_of(k) for k in numbers])).x.tolist()
        else:
            for k in numbers:
                if (at := sensor.time_of(k)) > self.sim.t:
                    self.sim.advance(at)
                seen.append(self.sim.x)
        if numbers:
            self._readings.record(numbers, seen[-len(numbers) :])

    def _room(self, sign: int) -> float:
        """Return how far (m) it is to the soft limit in the direction of sign."""
        limits, x = self.config.parameters.limits, self.x - self.config.offset
        return limits.soft_high - x if sign > 0 else x - limits.soft_low

    def _begin_cycles(self, steps: int) -> None:
        self.kind, self._queued = CYCLES, 0
        self._x_start = self.x
        self._start_cycles(abs(steps))

    def _start_cycles(self, count: int) -> None:
        self._cycles_start, self._cycles_u = self.t, self.sim.commanded
        self._peak, self._drive = self._sign * self._amplitude(), self.config.parameters.drive
        self.sim.start(self._drive_cycle(), count)
        self._plan()

    def _account_for_cycles(self) -> None:
        self._last = self.last_cycle
        self._done_before += self.sim.cycles_done
        if self.sim.cycles_done:
            self._dc_offset.moved([self._peak, 0.0])

    def _end_run(self) -> None:
        if self.kind == CYCLES:
            self._account_for_cycles()
            self._x_end = self.sim.position_of_cycle
        self._change, self._shortened = None, False

    def _drive_cycle(self) -> DriveCycle:
        return self.config.drive_cycle(
            self._sign, self._amplitude(), self.hertz or self.config.frequency
        )

    def _cycle_volts(self) -> list[float]:
        """Return the voltages (V) between which the running cycle has gone straight, up to now."""
        d = replace(
            self._drive, amplitude=abs(self._peak), frequency=1.0 / self.sim.drive_cycle.period
        )
        cycle = voltage_of(d, self._sign)
        since = self.t - self._cycles_start - self.sim.cycles_done * cycle.period
        ends = np.cumsum(cycle.durations)
        times = np.append(ends[ends < since], min(max(since, 0.0), cycle.period))
        levels = np.concatenate([[0.0], np.cumsum(cycle.strokes)])
        found: list[float] = np.interp(times, np.concatenate([[0.0], ends]), levels).tolist()
        return found

    def _amplitude(self) -> float:
        # What may be commanded, and with it what the running steps may have, can become less.
        return min(self._volts or math.inf, self.config.amplitude)

    def _plan(self) -> None:
        """Set the cycle after which the soft limits are checked again."""
        # Within a cycle the runner gets ahead by the stroke of the actuator at most.
        fit = self._room(self._sign) / self.config.stroke(self._amplitude())
        left = self.config.faults.steps_left(self.cycles_run)
        if not left:
            self.travel.confine(self.config.faults, self.config.offset, self.cycles_run)
        self._check = self.sim.cycles_done + int(min(max(fit, 0.0), _MOST_CYCLES, left or ENDLESS))

    def _stretch(self) -> tuple[int, float]:
        """Return the next cycle whose end needs a check, and that time (s)."""
        if self._change:
            return self._change
        last = self.sim.cycles_done + self.sim.cycles_left
        if self.kind == RAMP or last <= self._check:
            return last, self.sim.end_of_move
        return self._check, self._cycles_start + self._check * self.sim.drive_cycle.period
