# SPDX-License-Identifier: Apache-2.0
"""A stick-slip axis as its controller shows it: commands, states, limits, a sensor, events.

A new command replaces what is left of the running one; whatever changes, changes between cycles.
Time is an argument: the axis never reads a clock, and the same commands at the same times give
the same motion to the last bit, however often it is looked at. States: `machine.py`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from stickslip_ros import __version__
from stickslip_ros.axis import machine
from stickslip_ros.axis.closed_loop import ClosedLoop, StepSize
from stickslip_ros.axis.event_calls import call_of
from stickslip_ros.axis.events import CommandRefused, Event
from stickslip_ros.axis.motion import ARRIVED, CHANGE, CYCLES, LIMIT, REST, Motion
from stickslip_ros.axis.moves import Jog, Move, Scan, Task
from stickslip_ros.axis.named_files import digests_of
from stickslip_ros.axis.setup import setup_of
from stickslip_ros.axis.status import Status
from stickslip_ros.axis.trajectory import Course, Point, check_trajectory
from stickslip_ros.axis.watch import Watch
from stickslip_ros.model import Plant
from stickslip_ros.parameters import ParameterError, Values
from stickslip_ros.solver import Simulation, State


class Axis:
    """One axis. All times are seconds of simulation, all positions metres."""

    def __init__(self, parameters: Mapping[str, Any]) -> None:
        """Set up an axis at rest at 0; ParameterError if the parameters do not make one."""
        self._setup = setup_of(parameters)
        self._motion = Motion(self._setup)
        self._task: Task | None = None
        self._leaving = False  # the task ends with the running cycle, then comes the next one
        self._next: Task | None = None
        self._steps = StepSize()
        self._enabled = True
        self._fault = ""
        self._watch = Watch()
        self._limits_hit = 0
        self._refused = 0
        self._last_error = ""
        self._events: list[Event] = []
        digests = digests_of(self.parameters)
        self._note("start", "applied", **self.parameters, **digests, version=__version__)

    # -- what the axis is

    @property
    def parameters(self) -> Values:
        """The full set of parameters as set last."""
        return self._setup.parameters

    @property
    def state(self) -> State:
        """Runner, actuator and contact at the present time."""
        return self._motion.sim.state

    @property
    def plant(self) -> Plant:
        """Contact, mass and loads in force."""
        return self._motion.sim.plant

    @property
    def simulation(self) -> Simulation:
        """The solver below, to be read only."""
        return self._motion.sim

    @property
    def moving(self) -> bool:
        """True while cycles or a slow move of the actuator run."""
        return self._motion.kind != REST

    @property
    def mode(self) -> str:
        """The state of the axis as a device, one of `machine.STATES`."""
        if not self._enabled:
            return machine.DISABLED
        if self._fault:
            return machine.FAULT
        return self._task.state if self._task else machine.STOPPED

    @property
    def status(self) -> Status:
        """A snapshot of what the axis says of itself."""
        motion, setup, now = self._motion, self._setup, self._motion.sim.state
        position = self._measured(now.x)
        loop = self._task if isinstance(self._task, ClosedLoop) else None
        target = loop.course.at(now.t) if loop else math.nan
        left = motion.steps_left
        if self._leaving:
            left = self._next.steps if isinstance(self._next, Move) else 0
        last_step, lost = motion.last_cycle
        return Status(
            state=self.mode,
            moving=self.moving,
            enabled=self._enabled,
            fault=self._fault,
            steps_done=motion.steps_done,
            steps_left=left,
            step_count=motion.step_count,
            amplitude=setup.amplitude,
            stroke=setup.stroke(setup.amplitude),
            frequency=motion.hertz or setup.frequency,
            last_step=last_step,
            mean_step=motion.mean_step,
            backstep=motion.sim.backstep,
            lost=lost,
            position=position,
            zero_offset=setup.offset,
            velocity=self._watch.velocity,
            scan_level=motion.level / setup.gain,
            load=motion.load,
            target=target,
            target_reached=loop is not None and loop.reached,
            following_error=target - position if loop else math.nan,
            limits_hit=self._limits_hit,
            held_at=("", "high", "low")[motion.sim.stopped],
            refused=self._refused,
            last_error=self._last_error,
        )

    def take_events(self) -> list[Event]:
        """Return the events since the last call, oldest first, and forget them."""
        events, self._events = self._events, []
        return events

    # -- commands; each raises CommandRefused, and changes nothing, if it cannot be

    def command_steps(self, steps: int) -> None:
        """Run that many steps, the sign is the direction; 0 finishes the cycle and stops."""
        command = "steps" if steps else "steps 0"
        self._admit(command, lambda: self._setup.check_steps(steps), value=steps)
        self._take(Move(steps) if steps else None)

    def command_jog(self, hertz: float) -> None:
        """Step without end at a frequency (Hz), the sign is the direction; 0 stops.

        Later amplitudes and frequencies change it from the next cycle on.
        """
        setup = self._setup
        self._admit(
            "jog" if hertz else "jog 0",
            lambda: setup.check_drive(setup.amplitude, abs(hertz) or setup.frequency),
            value=hertz,
        )
        self._take(Jog(hertz) if hertz else None)

    def command_scan(self, volts: float) -> None:
        """Move the actuator slowly to a level (V) and leave it there, without a slip."""
        self._admit("scan", lambda: self._setup.check_level(volts), value=volts)
        self._take(Scan(self._setup.nearest(volts), self._note_limit))

    def command_position(self, x: float) -> None:
        """Go to a measured position (m) in closed loop and hold it."""
        self._admit("position", lambda: self._setup.check_target(x), value=x)
        self._take(self._closed_loop("target", x, []))

    def command_trajectory(self, joints: Sequence[str], points: Sequence[Point]) -> None:
        """Follow points (time from now in s, measured position in m) in closed loop; hold the last.

        joints names the one joint of the axis, <axis_name>_slider.
        """
        joint = f"{self.parameters['axis_name']}_slider"
        checked = self._admit(
            "trajectory",
            lambda: check_trajectory(joints, points, joint, self._setup.check_target),
            joints=list(joints),
            points=[list(point) for point in points],
        )
        self._take(self._closed_loop("trajectory", self._measured(self.state.x), checked))

    def command_amplitude(self, volts: float) -> None:
        """Set the amplitude (V peak to peak) from the next cycle on."""
        setup = self._setup

        def check() -> None:
            setup.check_drive(volts, setup.frequency)
            setup.rounded("amplitude", volts)

        self._admit("amplitude", check, value=volts)
        setup.amplitude = setup.nearest(volts)
        self._change_drive()

    def command_frequency(self, hertz: float) -> None:
        """Set the frequency (Hz) from the next cycle on."""
        setup = self._setup
        self._admit("frequency", lambda: setup.check_drive(setup.amplitude, hertz), value=hertz)
        setup.frequency = hertz
        self._motion.hertz = None
        self._change_drive()

    def stop(self) -> None:
        """End what runs: steps after their cycle, a scan where it is."""
        self._admit("stop")
        self._take(None)

    def reset(self) -> None:
        """Leave a fault."""
        self._admit("reset")
        self._fault = ""

    def zero(self) -> None:
        """Count positions from the present reading of the sensor on."""
        self._admit("zero")
        self._setup.offset += self._measured(self.state.x)

    def enable(self, on: bool) -> None:
        """Take commands, or none; what runs when disabled ends as by `stop`."""
        self._admit("enable" if on else "disable", value=on)
        self._enabled = on
        if not on:
            self._take(None)

    def set_load(self, newtons: float) -> None:
        """Put an external force along the axis (N) in force from now on."""
        self._admit("load", lambda: self._setup.check_load(newtons), value=newtons)
        self._motion.set_load(newtons)
        self._watch.forgive(self._motion)

    def set_parameters(self, changes: Mapping[str, Any]) -> None:
        """Change parameters; what concerns the running cycle changes with the next one."""

        def check() -> tuple[Values, dict[str, str]]:
            new = self.checked(changes)
            return new, digests_of(new)

        new, digests = self._admit("parameters", check, **changes)
        self._events[-1].details.update(digests)
        self._setup.take(new)
        self._motion.change_later()

    def checked(self, changes: Mapping[str, Any]) -> Values:
        """Return the parameters as they would be with changes; ParameterError if they can't be."""
        return self._setup.changed(changes)

    def refuse(self, name: str, value: object, reason: str) -> CommandRefused:
        """Count a command that never got as far as the axis; return the error to raise."""
        return self._refusal(name, reason, value=value)

    def repeat(self, name: str, details: Mapping[str, Any]) -> None:
        """Carry out a command as noted in an event with outcome "applied"; "start" is past."""
        if name != "start":
            method, arguments = call_of(name, details)
            getattr(self, method)(*arguments)

    # -- time

    def advance(self, t: float) -> None:
        """Advance to time t (s), not before the present one."""
        now = self._motion.t
        if not now <= t < math.inf:
            raise ValueError(f"time cannot run back from {now} s to {t} s")
        self._run(t)
        self._motion.sim.advance(t)

    def _run(self, t: float) -> None:
        """Do all that is due until time t (s)."""
        motion = self._motion
        while True:
            look, arrival, task = self._watch.due, motion.due, self._task
            tick = task.due if task else math.inf
            if min(look, arrival, tick) > t:
                return
            if arrival <= min(look, tick):
                self._arrive()
            elif task and tick <= look:
                motion.sim.advance(tick)
                self._set_fault(task.tick(motion))
                self._end_idle()
            else:
                motion.sim.advance(look)
                self._look()

    def _arrive(self) -> None:
        motion = self._motion
        event = motion.arrive()
        if event == CHANGE:
            if self._leaving:
                self._change_task()
                return
            event = motion.go_on()
        if event == LIMIT:
            self._note_limit("soft_high" if motion.sim.pattern.sign > 0 else "soft_low")
        if event in (ARRIVED, LIMIT):
            if motion.kind == CYCLES:
                motion.end_cycles()
            self._task_arrived(ended=event == LIMIT)

    def _task_arrived(self, ended: bool) -> None:
        task = self._task
        if task and (task.arrived(self._motion) or ended):
            self._end(task)
            self._task = None

    def _look(self) -> None:
        end = self._watch.look(self._motion)
        if end:
            self._note_limit(end)
        if self._enabled and not self._fault:
            self._set_fault(self._watch.fault(self._motion, self._task))

    # -- inside

    def _admit(
        self, command: str, check: Callable[[], Any] = lambda: None, /, **details: Any
    ) -> Any:
        """Note a command as applied, or refuse it by the table or its check; return the check's."""
        name = "enable" if command == "disable" else command.split()[0]
        reason = machine.refusal(command, self.mode, self._fault)
        if not reason:
            try:
                checked = check()
            except ParameterError as error:
                reason = str(error)
        if reason:
            raise self._refusal(name, reason, **details)
        self._note(name, "applied", **details)
        return checked

    def _take(self, task: Task | None) -> None:
        """Replace what runs by a task, or end it; a running cycle is finished first."""
        motion = self._motion
        if motion.kind == CYCLES:
            self._leaving, self._next = True, task
            motion.change_later()
            return
        if motion.kind != REST:
            motion.halt()
        self._next = task
        self._change_task()
        self._run(motion.t)

    def _change_task(self) -> None:
        motion, old, new = self._motion, self._task, self._next
        if motion.kind == CYCLES:
            motion.end_cycles()
            motion.take_parameters()
        self._task, self._next, self._leaving = new, None, False
        self._watch.forgive(motion)
        if new is None:
            if old:
                self._end(old)
            return
        new.begin(motion)
        self._end_idle()

    def _end_idle(self) -> None:
        """End the task if it waits for nothing."""
        if self._task and self._task.due == math.inf and self._motion.kind == REST:
            self._task_arrived(ended=False)

    def _end(self, task: Task) -> None:
        """Tell that a task has ended."""
        x, motion = self.state.x, self._motion
        if isinstance(task, Move | Jog):
            self._note("move", "finished", steps=motion.steps_done, position=x)
        elif isinstance(task, Scan):
            self._note("scan", "finished", level=motion.level / self._setup.gain, position=x)

    def _change_drive(self) -> None:
        if self._motion.kind == CYCLES:
            self._motion.change_later()

    def _closed_loop(self, name: str, x: float, points: Sequence[Point]) -> ClosedLoop:
        return ClosedLoop(name, Course(self._motion.t, x, points), self._steps, self._note)

    def _measured(self, x: float) -> float:
        """Return the measured position (m) with the runner at x (m) now."""
        sensor = self._setup.sensor
        return self._setup.reading(x, sensor.number_at(self._motion.t))

    def _note_limit(self, limit: str) -> None:
        self._limits_hit += 1
        self._note("limit", "hit", limit=limit, position=self._measured(self.state.x))

    def _set_fault(self, reason: str) -> None:
        if not reason:
            return
        self._fault = self._last_error = reason
        self._note("fault", "fault", reason=reason)
        self._take(None)

    def _refusal(self, name: str, reason: str, /, **details: Any) -> CommandRefused:
        self._refused += 1
        self._last_error = reason
        self._note(name, "refused", **{**details, "reason": reason})
        return CommandRefused(reason)

    def _note(self, name: str, outcome: str, /, **details: Any) -> None:
        self._events.append(Event(self._motion.t, name, outcome, details))
