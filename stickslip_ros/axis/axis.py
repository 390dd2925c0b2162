# SPDX-License-Identifier: Apache-2.0
"""A stick-slip axis as its controller presents it: commands, states, limits, a sensor, events.

A new command replaces what is left of the running one; whatever changes, changes between cycles.
Time is an argument: the axis never reads a clock, and the same commands at the same times give
the same motion to the last bit, however often its state is read. States: `state_machine.py`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from typing import Any

from stickslip_ros import __version__
from stickslip_ros.axis import state_machine
from stickslip_ros.axis.actuation import ARRIVED, CHANGE, CYCLES, LIMIT, REST, Actuation
from stickslip_ros.axis.closed_loop import ClosedLoop, Point, StepSize
from stickslip_ros.axis.commands import COMMANDS
from stickslip_ros.axis.config import Config
from stickslip_ros.axis.events import CommandRefused, Event, shortened
from stickslip_ros.axis.named_files import digests_of
from stickslip_ros.axis.state_machine import AxisStatus, refusal
from stickslip_ros.axis.supervisor import Supervisor
from stickslip_ros.axis.tasks import JogTask, ScanTask, StepTask, Task
from stickslip_ros.model import Plant
from stickslip_ros.parameters import ParameterError, Parameters
from stickslip_ros.solver import Simulation, State


class Axis:
    """One axis. All times are seconds of simulation, all positions metres."""

    def __init__(self, parameters: Parameters | Mapping[str, Any]) -> None:
        """Set up an axis at rest at 0; ParameterError if the parameters do not make one."""
        p = Parameters.of(parameters)
        self.config = Config.of(p)
        self.actuation = Actuation(self.config)
        self._task: Task | None = None
        self._leaving = False  # the task ends with the running cycle, then comes the next one
        self._next: Task | None = None
        self.step_size = StepSize()
        self._enabled = True
        self.fault = ""
        self._stalled = False  # the solver has failed
        self.supervisor = Supervisor()
        self._limits_hit = 0
        self._refused = 0
        self._last_error = ""
        self._events: list[Event] = []
        self.note("start", "applied", **p.flat(), **digests_of(p), version=__version__)

    # -- what the axis is

    @property
    def parameters(self) -> Parameters:
        """The full set of parameters as set and commanded last."""
        return self.config.parameters

    @property
    def operating_point(self) -> Parameters:
        """The parameters with what acts beside them: the frequency of a jog, the external load."""
        p, actuation = self.parameters, self.actuation
        drive = replace(p.drive, frequency=actuation.hertz or p.drive.frequency)
        return replace(
            p, drive=drive, runner=replace(p.runner, force=p.runner.force + actuation.load)
        )

    @property
    def state(self) -> State:
        """Runner, actuator and contact at the present time."""
        return self.actuation.sim.state

    @property
    def plant(self) -> Plant:
        """Contact, mass and loads in force."""
        return self.actuation.sim.plant

    @property
    def simulation(self) -> Simulation:
        """The solver below, to be read only."""
        return self.actuation.sim

    @property
    def moving(self) -> bool:
        """True while cycles or a slow move of the actuator run."""
        return self.actuation.kind != REST

    @property
    def mode(self) -> str:
        """The state of the axis as a device, one of `state_machine.STATES`."""
        if not self._enabled:
            return state_machine.DISABLED
        if self.fault:
            return state_machine.FAULT
        return self._task.state if self._task else state_machine.STOPPED

    @property
    def status(self) -> AxisStatus:
        """A snapshot of the status that the axis reports."""
        actuation, config, now = self.actuation, self.config, self.actuation.sim.state
        position = self.measured
        loop = self._task if isinstance(self._task, ClosedLoop) else None
        target = loop.trajectory.at(now.t) if loop else math.nan
        left = actuation.steps_left
        if self._leaving:
            left = self._next.steps if isinstance(self._next, StepTask) else 0
        last_step, lost = actuation.last_cycle
        return AxisStatus(
            state=self.mode,
            moving=self.moving,
            enabled=self._enabled,
            fault=self.fault,
            steps_done=actuation.steps_done,
            steps_left=left,
            step_count=actuation.step_count,
            amplitude=config.amplitude,
            stroke=config.stroke(config.amplitude),
            frequency=actuation.hertz or config.frequency,
            last_step=last_step,
            mean_step=actuation.mean_step,
            backstep=actuation.sim.backstep,
            lost=lost,
            position=position,
            zero_offset=config.offset,
            velocity=self.supervisor.velocity,
            scan_level=actuation.level / config.gain,
            load=actuation.load,
            target=target,
            target_reached=loop is not None and loop.reached,
            following_error=target - position if loop else math.nan,
            limits_hit=self._limits_hit,
            held_at=("", "high", "low")[actuation.sim.stopped],
            refused=self._refused,
            last_error=self._last_error,
        )

    def compile_ahead(self) -> None:
        """Have everything compiled that commands may call later, when it would cost deadlines."""
        spare = Axis(self.parameters)
        spare.command_steps(1)
        spare.advance(0.5 / spare.status.frequency)
        spare.set_load(0.0)  # another plant in the middle of a cycle
        spare.stop()
        spare.advance(2.0 / spare.status.frequency)

    def take_events(self) -> list[Event]:
        """Return the events since the last call, oldest first, and forget them."""
        events, self._events = self._events, []
        return events

    # -- commands; each raises CommandRefused and changes nothing if it is refused

    def command(self, name: str, *arguments: Any) -> None:
        """Carry out a command of the registry, `commands.COMMANDS`."""
        command = COMMANDS[name]
        arguments = command.completed(arguments)
        if command.ignored(self, *arguments):
            return
        details = command.details(arguments)
        reason = refusal(command.row(arguments), self.mode, self.fault)
        if not reason:
            try:
                checked = command.check(self, *arguments)
                prepared = arguments if checked is None else (checked,)
                more = command.more_details(*prepared)
            except ParameterError as error:
                reason = str(error)
        if reason:
            raise self._refusal(name, reason, **details)
        self.note(name, "applied", **details, **more)
        with self._solving():
            if command.effect:
                command.effect(self, *prepared)
            elif command.task:
                off = command.turns_off(arguments)
                running = self.closed_loop
                task = None if off else command.task(self, *prepared)
                if task is None or task is not running:
                    self._replace(task)

    def command_steps(self, steps: int) -> None:
        """Run that many steps, the sign is the direction; 0 finishes the cycle and stops."""
        self.command("steps", steps)

    def command_jog(self, hertz: float) -> None:
        """Step without end at a frequency (Hz), the sign is the direction; 0 stops.

        Later amplitudes and frequencies change it from the next cycle on.
        """
        self.command("jog", hertz)

    def command_scan(self, volts: float) -> None:
        """Move the actuator slowly to a level (V) and leave it there, without a slip."""
        self.command("scan", volts)

    def command_position(self, x: float) -> None:
        """Go to a measured position (m) in closed loop and hold it."""
        self.command("position", x)

    def command_trajectory(self, joints: Sequence[str], points: Sequence[Point]) -> None:
        """Follow points (time from now in s, measured position in m) in closed loop; hold the last.

        joints names the one joint of the axis, <axis_name>_slider.
        """
        self.command("trajectory", list(joints), [list(point) for point in points])

    def command_amplitude(self, volts: float) -> None:
        """Set the amplitude (V peak to peak) from the next cycle on."""
        self.command("amplitude", volts)

    def command_frequency(self, hertz: float) -> None:
        """Set the frequency (Hz) from the next cycle on."""
        self.command("frequency", hertz)

    def stop(self) -> None:
        """End what runs: steps after their cycle, a scan where it is."""
        self.command("stop")

    def reset(self) -> None:
        """Leave a fault."""
        self.command("reset")

    def zero(self) -> None:
        """Count positions from the present reading of the sensor on."""
        self.command("zero")

    def enable(self, on: bool) -> None:
        """Accept commands or refuse them; disabling ends the running command as `stop` does."""
        self.command("enable", on)

    def set_load(self, newtons: float) -> None:
        """Apply an external force along the axis (N) from now on."""
        self.command("load", newtons)

    def set_parameters(self, changes: Mapping[str, Any]) -> None:
        """Change parameters; what concerns the running cycle changes with the next one."""
        self.command("parameters", changes)

    def checked(self, changes: Mapping[str, Any]) -> Parameters:
        """Return the parameters with changes; ParameterError if the axis cannot have them."""
        return self.config.changed(changes, self.jogs)

    def refuse(self, name: str, value: object, reason: str) -> CommandRefused:
        """Count a command that did not reach the axis as refused; return the error to raise."""
        return self._refusal(name, reason, value=value)

    def repeat(self, name: str, details: Mapping[str, Any]) -> None:
        """Carry out a command as noted in an event with outcome "applied"; "start" is past.

        Raises CommandRefused also for an event that no axis can have noted.
        """
        if name == "start":
            return
        try:
            arguments = COMMANDS[name].arguments_of(details)
        except KeyError as error:
            raise CommandRefused(f"event {name!r} lacks {error}; axes make no such event") from None
        self.command(name, *arguments)

    # -- time

    def advance(self, t: float) -> None:
        """Advance to time t (s), not before the present one; does nothing in a solver fault."""
        now = self.actuation.t
        if not now <= t < math.inf:
            raise ValueError(f"time cannot go back from {now} s to {t} s")
        if not self._stalled:
            with self._solving():
                self._run(t)
                self.actuation.advance(t)

    @contextmanager
    def _solving(self) -> Iterator[None]:
        """Turn what the solver or the drive cannot do into a fault: the axis stops until a reset.

        Its time stops too: after the reset, the axis continues where the solver stopped.
        """
        try:
            yield
        except (ArithmeticError, ParameterError) as error:
            self._stalled = True
            what = "drive" if isinstance(error, ParameterError) else "solver"
            self.fault = self._last_error = f"the {what} cannot go on: {error}"
            self.note("fault", "fault", reason=self.fault)
            task, self._task, self._next, self._leaving = self._task, None, None, False
            with suppress(ArithmeticError, ParameterError):
                self.actuation.abort()
            if task:
                self._end(task)

    def _run(self, t: float) -> None:
        """Do everything that is due until time t (s)."""
        actuation = self.actuation
        while True:
            look, arrival, task = self.supervisor.due, actuation.due, self._task
            tick = task.due if task else math.inf
            if min(look, arrival, tick) > t:
                return
            if arrival <= min(look, tick):
                self._arrive()
            elif task and tick <= look:
                actuation.advance(tick)
                self._set_fault(task.tick(actuation))
                self._end_idle()
            else:
                actuation.advance(look)
                self._look()

    def _arrive(self) -> None:
        actuation = self.actuation
        event = actuation.arrive()
        if event == CHANGE:
            if self._leaving:
                self._change_task()
                return
            event = actuation.go_on()
        if event == LIMIT:
            self.note_limit("soft_high" if actuation.sim.drive_cycle.sign > 0 else "soft_low")
        if event in (ARRIVED, LIMIT):
            if actuation.kind == CYCLES:
                actuation.end_cycles()
            self._task_arrived(ended=event == LIMIT)

    def _task_arrived(self, ended: bool) -> None:
        task = self._task
        if task and (task.arrived(self.actuation) or ended):
            self._end(task)
            self._task = None

    def _look(self) -> None:
        end = self.supervisor.look(self.actuation)
        if end:
            self.note_limit(end)
        if self._enabled and not self.fault:
            self._set_fault(self.supervisor.fault(self.actuation, self._task))

    # -- inside

    def _replace(self, task: Task | None) -> None:
        """Replace the running task by another or by none; a running cycle is finished first."""
        actuation = self.actuation
        if actuation.kind == CYCLES:
            self._leaving, self._next = True, task
            actuation.change_later()
            return
        if actuation.kind != REST:
            actuation.halt()
        self._next = task
        self._change_task()
        self._run(actuation.t)

    def _change_task(self) -> None:
        actuation, old, new = self.actuation, self._task, self._next
        if actuation.kind == CYCLES:
            actuation.end_cycles()
            actuation.take_parameters()
        self._task, self._next, self._leaving = new, None, False
        self.supervisor.task_began(actuation)
        if new is None:
            if old:
                self._end(old)
            return
        new.begin(actuation)
        self._end_idle()

    def _end_idle(self) -> None:
        """End the task if it does not wait for anything."""
        if self._task and self._task.due == math.inf and self.actuation.kind == REST:
            self._task_arrived(ended=False)

    def _end(self, task: Task) -> None:
        """Report that a task has ended."""
        actuation, x = self.actuation, self.actuation.x
        if isinstance(task, StepTask | JogTask):
            self.note("move", "finished", steps=actuation.steps_done, position=x)
        elif isinstance(task, ScanTask):
            self.note("scan", "finished", level=actuation.level / self.config.gain, position=x)

    @property
    def closed_loop(self) -> ClosedLoop | None:
        """The closed loop, if that is what runs, or what comes after the running cycle."""
        task = self._next if self._leaving else self._task
        return task if isinstance(task, ClosedLoop) else None

    @property
    def jogs(self) -> list[float]:
        """The frequency (Hz) of the jog that runs or comes after the running cycle; none if none.

        It is not that of the parameters, so what is changed has to suit it as well.
        """
        if self._leaving:
            return [abs(self._next.hertz)] if isinstance(self._next, JogTask) else []
        return [self.actuation.hertz] if self.actuation.hertz else []

    @property
    def measured(self) -> float:
        """The present reading of the sensor, m."""
        return self.config.reading(
            self.actuation.seen, self.config.sensor.number_at(self.actuation.t)
        )

    def note_limit(self, limit: str) -> None:
        """Count and report that a limit of that name was hit."""
        self._limits_hit += 1
        self.note("limit", "hit", limit=limit, position=self.measured)

    def clear_fault(self) -> None:
        """Continue after a fault."""
        self.fault = ""
        self._stalled = False

    def set_enabled(self, on: bool) -> None:
        """Accept commands from now on, or refuse them and end the running one."""
        self._enabled = on
        if not on:
            self._replace(None)

    def _set_fault(self, reason: str) -> None:
        if not reason:
            return
        self.fault = self._last_error = reason
        self.note("fault", "fault", reason=reason)
        self._replace(None)

    def _refusal(self, name: str, reason: str, /, **details: Any) -> CommandRefused:
        self._refused += 1
        self._last_error = reason = shortened(reason)
        self.note(name, "refused", **shortened({**details, "reason": reason}))
        return CommandRefused(reason)

    def note(self, name: str, outcome: str, /, **details: Any) -> None:
        """Add an event at the present time."""
        self._events.append(Event(self.actuation.t, name, outcome, details))
