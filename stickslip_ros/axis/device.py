# SPDX-License-Identifier: Apache-2.0
"""Runs the tasks of an axis in time, with checks between them, faults and events.

Changes take effect between drive cycles. `commands.py` defines the commands, `axis.py` has the
public class.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import replace
from typing import Any

from stickslip_ros.axis.actuation import ARRIVED, CHANGE, CYCLES, LIMIT, REST, SOON, Actuation
from stickslip_ros.axis.closed_loop import ClosedLoop, StepSize, expected_loss
from stickslip_ros.axis.command import DISABLED, FAULT, HOMING, STOPPED
from stickslip_ros.axis.config import Config
from stickslip_ros.axis.events import (
    INJECTED,
    START,
    CommandRefused,
    Event,
    is_set_point,
    shorten,
)
from stickslip_ros.axis.faults import MOVING, Moment
from stickslip_ros.axis.tasks import AxisTask, JogTask, ScanTask, StepTask, Supervisor
from stickslip_ros.physics.model.arithmetic import arithmetic
from stickslip_ros.physics.model.versions import COMMANDS_CHANGED, MODEL_VERSION
from stickslip_ros.physics.parameters import ParameterError, Parameters
from stickslip_ros.physics.parameters.named_files import digests_of
from stickslip_ros.physics.solver.driven import simulation_of
from stickslip_ros.version import __version__

#: Steps that show how fast the axis goes: the first ones, from rest, are longer or shorter
_TRIED = 10
_MOST_SPEEDS = 8  # that are kept
#: Parameters that let a paused time go on for a while
STEPS_OF_TIME = ("step_time", "step_cycles")


class Device:
    """The tasks of one axis in time. All times are seconds of simulation, all positions metres."""

    def __init__(
        self, parameters: Parameters | Mapping[str, Any], model: int = MODEL_VERSION
    ) -> None:
        """Set up an axis at rest at 0; ParameterError if the parameters do not make one.

        model: the version whose commands it follows, see `finishes_cycles`.
        """
        p = Parameters.of(parameters)
        #: Whether it does as before model 18: a stop finishes its cycle, a velocity goes on to
        #: where it was to be after its time, and a reset keeps what the closed loop has learned.
        self.finishes_cycles = model < COMMANDS_CHANGED
        self.config: Config = Config.of(p)
        self.actuation = Actuation(self.config)
        self._task: AxisTask | None = None
        self._leaving = False  # the task ends with the running cycle, then comes the next one
        self._next: AxisTask | None = None
        self.step_size = StepSize(expected_loss(self.config.plant().contact))
        self._enabled = True
        self.paused = p.node.start_paused  #: True while its time is paused
        self.fault = ""
        self._stalled = False  # the solver has failed
        self.supervisor = Supervisor()
        self._limits_hit = 0
        self._refused = 0
        self._last_error = ""
        self._events: list[Event] = []
        self._noted = 0  # events so far
        self._speeds: dict[Any, float] = {}  # m/s, of steps
        rules = COMMANDS_CHANGED - 1 if self.finishes_cycles else MODEL_VERSION
        versions = {"version": __version__, "model_version": rules}
        versions["arithmetic"] = arithmetic()
        self.note(START, "applied", **p.flat(), **digests_of(p), **versions)
        self.take_faults()

    @property
    def parameters(self) -> Parameters:
        """The full set of parameters as set and commanded last."""
        return self.config.parameters

    @property
    def moving(self) -> bool:
        """True while cycles or a slow move of the actuator run."""
        return self.actuation.kind != REST

    @property
    def mode(self) -> str:
        """The state of the axis as a device, one of `command.STATES`."""
        if not self._enabled:
            return DISABLED
        if self.fault:
            return FAULT
        return self._task.state if self._task else STOPPED

    @property
    def closed_loop(self) -> ClosedLoop | None:
        """The closed loop, if it runs or begins after the running cycle; not that of the way home.

        Set points change it.
        """
        task = self._next if self._leaving else self._task
        return task if isinstance(task, ClosedLoop) and task.state != HOMING else None

    @property
    def jogs(self) -> list[float]:
        """The frequency (Hz) of the jog that runs or begins after the running cycle; empty if none.

        It differs from that of the parameters, so changed parameters have to suit both.
        """
        if self._leaving:
            return [abs(self._next.hertz)] if isinstance(self._next, JogTask) else []
        return [self.actuation.hertz] if self.actuation.hertz else []

    @property
    def measured(self) -> float:
        """The present reading of the sensor, m."""
        return self.config.reading(
            self.actuation.sensed, self.config.sensor.number_at(self.actuation.t)
        )

    @property
    def arrived(self) -> float:
        """The reading of the sensor that has arrived last, m; nan: it gives none."""
        k, x = self.actuation.arrived
        return self.config.reading(x, k)

    # -- time

    def advance(self, t: float) -> None:
        """Advance to time t (s), not before the present one; does nothing in a solver fault."""
        actuation = self.actuation
        if not actuation.sim.t <= t < math.inf:
            raise ValueError(f"time cannot go back from {actuation.t} s to {t} s")
        if self._stalled:
            return
        actuation.asked = t
        try:  # not `_solving`, which takes a tenth of a block at rest
            if self._task or not (actuation.stands and self.supervisor.pass_by(actuation, t)):
                self._run(t)
            actuation.advance(t)
        except (ArithmeticError, ParameterError) as error:
            self._fail(error)

    # -- used by commands

    def speed_of_steps(self, sign: int) -> float:
        """Return how fast (m/s, without sign) steps go in the direction of sign at this load."""
        config, p = self.config, self.config.parameters
        size = self.step_size.of(config.stroke(config.amplitude), sign)
        if p.friction.contacts > 1:  # these take their time to be simulated
            return size * config.frequency
        asked = p, self.actuation.load, sign
        if asked not in self._speeds:
            if len(self._speeds) > _MOST_SPEEDS:
                self._speeds.clear()
            spare = simulation_of(p, self.actuation.sim.plant)
            with suppress(ArithmeticError, ParameterError):
                spare.start(config.drive_cycle(sign, config.amplitude, config.frequency), _TRIED)
                found, half = spare.run_cycles(_TRIED).position, _TRIED // 2
                size = sign * float(found[-1] - found[half - 1]) / (_TRIED - half)
            self._speeds[asked] = max(size, 0.0) * config.frequency
        return self._speeds[asked]

    def note_limit(self, limit: str) -> None:
        """Count and report that a limit of that name was hit."""
        self._limits_hit += 1
        self.note("limit", "hit", limit=limit, position=self.measured)

    def clear_fault(self) -> None:
        """Continue after a fault, as if nothing had been before it."""
        self.fault = ""
        self._stalled = False
        if not self.finishes_cycles:
            self.step_size = StepSize(expected_loss(self.config.plant().contact))

    def set_enabled(self, on: bool) -> None:
        """Accept commands from now on, or refuse them and end the running one."""
        self._enabled = on
        if not on:
            self._replace(None, breaks_off=True)

    def take_faults(self) -> bool:
        """Let the faults that the parameters name act from now on, and others no more.

        Returns whether that changes the motion.
        """
        actuation, old = self.actuation, self.config.faults
        k = self.config.sensor.number_at(actuation.t)
        reading = self.config.reading(actuation.sensed, k) + self.config.offset
        now = Moment(actuation.t, actuation.x, reading, actuation.cycles_run)
        new = old.changed(self.parameters, now)
        if new.active == old.active:
            return False
        self.config.faults = new
        moving = False
        for name in dict.fromkeys((*old.active, *new.active)):
            if old.active.get(name) != new.active.get(name):
                faults, outcome = (new, "began") if name in new else (old, "ended")
                self.note(INJECTED, outcome, fault=name, value=faults.value(name))
                moving = moving or name in MOVING
        if moving:
            actuation.faults_changed()
        return moving

    def checked(self, changes: Mapping[str, Any]) -> Parameters:
        """Return the parameters with changes; ParameterError if the axis cannot have them."""
        new = self.config.changed(changes, self.jogs)
        asked = [name for name in STEPS_OF_TIME if changes.get(name)]
        if asked and not self.paused:
            raise ParameterError(f"{asked[0]} is {changes[asked[0]]} while time runs: pause first")
        return new

    def note(self, name: str, outcome: str, /, **details: Any) -> None:
        """Add an event at the present time."""
        event = Event(self.actuation.t, name, outcome, details)
        if not is_set_point(event):  # these have topics of their own
            self._noted += 1
            event = replace(event, number=self._noted)
        self._events.append(event)

    def refuse(self, name: str, reason: str, /, **details: Any) -> CommandRefused:
        """Count and note a command as refused; return the error to raise."""
        self._refused += 1
        self._last_error = reason = shorten(reason)
        self.note(name, "refused", **shorten({**details, "reason": reason}))
        return CommandRefused(reason)

    @contextmanager
    def _solving(self) -> Iterator[None]:
        """Turn errors of solver and drive into a fault."""
        try:
            yield
        except (ArithmeticError, ParameterError) as error:
            self._fail(error)

    def _fail(self, error: Exception) -> None:
        """Stop until a reset, because of an error of solver or drive.

        The time stops, too: after the reset, the axis continues where the solver stopped.
        """
        self._stalled = True
        what = "drive" if isinstance(error, ParameterError) else "solver"
        self.fault = self._last_error = f"the {what} cannot go on: {error}"
        self.note("fault", "fault", reason=self.fault)
        task, self._task, self._next, self._leaving = self._task, None, None, False
        with suppress(ArithmeticError, ParameterError):
            self.actuation.break_off()
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
                self.supervisor.check(actuation)
                self._note_end_of_travel()
                if self._enabled and not self.fault:
                    self._set_fault(self.supervisor.fault(actuation, self._task))

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
        if task and (ended or task.arrived(self.actuation)):
            self._note_end_of_travel()
            self._end(task)
            self._task = None

    # -- inside

    def _replace(self, task: AxisTask | None, breaks_off: bool = False) -> None:
        """Replace the running task by another or by none; a running cycle is finished first.

        breaks_off: unless it would end later than `SOON`, then it is broken off.
        """
        actuation = self.actuation
        if actuation.kind == CYCLES:
            late = actuation.cycle_ends > actuation.t + SOON
            if not (breaks_off and late) or self.finishes_cycles:
                self._leaving, self._next = True, task
                actuation.change_later()
                return
            actuation.break_off()
            level = actuation.level / self.config.gain
            self.note("cycle", "broken off", level=level, position=actuation.x)
        elif actuation.kind != REST:
            actuation.halt()
        self._next = task
        self._change_task()
        self._run(actuation.t)

    def _change_task(self) -> None:
        actuation, old, new = self.actuation, self._task, self._next
        if actuation.kind == CYCLES:
            actuation.end_cycles()
            actuation.apply_parameters()
        self._note_end_of_travel()
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

    def _note_end_of_travel(self) -> None:
        if end := self.supervisor.hit(self.actuation):
            self.note_limit(end)

    def _end(self, task: AxisTask) -> None:
        """Report that a task has ended."""
        actuation, x = self.actuation, self.actuation.x
        if isinstance(task, StepTask | JogTask):
            self.note("move", "finished", steps=actuation.steps_done, position=x)
        elif isinstance(task, ScanTask):
            self.note("scan", "finished", level=actuation.level / self.config.gain, position=x)

    def _set_fault(self, reason: str) -> None:
        if not reason:
            return
        self.fault = self._last_error = reason
        self.note("fault", "fault", reason=reason)
        self._replace(None, breaks_off=True)
