# SPDX-License-Identifier: Apache-2.0
"""A stick-slip axis as its controller presents it: commands, states, limits, a sensor, events.

A new command replaces the rest of the running command; all changes happen between drive cycles.
Time is an argument: the axis never reads a clock, and the same commands at the same times give
the same motion to the last bit, however often its state is read. States: `command.py`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

from stickslip_ros.axis.closed_loop import ClosedLoop
from stickslip_ros.axis.command import LONG_WAIT, STOP_ENDS, AxisStatus, Command, refusal
from stickslip_ros.axis.commands import COMMANDS, command_of
from stickslip_ros.axis.device import Device
from stickslip_ros.axis.events import TRIP, CommandRefused, Event
from stickslip_ros.axis.faults import REFUSE
from stickslip_ros.axis.tasks import StepTask
from stickslip_ros.physics.parameters import ParameterError, Parameters
from stickslip_ros.physics.solver import Simulation, State


class Axis(Device):
    """One axis. All times are seconds of simulation, all positions metres."""

    # -- state

    @property
    def operating_point(self) -> Parameters:
        """The parameters with the frequency of a jog and the external load in effect."""
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
    def simulation(self) -> Simulation:
        """The solver below, to be read only."""
        return self.actuation.sim

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
            paused=self.paused,
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
            begins=actuation.changes_at,
            position=position,
            zero_offset=config.offset,
            velocity=self.supervisor.velocity,
            scan_level=actuation.level / config.gain,
            load=actuation.load,
            target=target,
            target_reached=loop is not None and loop.reached,
            following_error=target - position if loop else math.nan,
            limits_hit=self._limits_hit,
            held_at=("", "high", "low")[actuation.travel.held],
            injected=", ".join(config.faults.active),
            refused=self._refused,
            last_error=self._last_error,
        )

    def compile_ahead(self) -> None:
        """Have everything compiled that commands may call later, when it would cost deadlines."""
        # Without a bandwidth: cycles may take hours, and all of them would be sampled.
        p = self.parameters.replace(fault=None, sensor_bandwidth=None)
        with suppress(ParameterError):  # nor would the supervisor look a hundred times a second
            p = p.replace(frequency=max(p.drive.frequency, 1.0))
        spare = Axis(p)
        cycle = 1.0 / spare.status.frequency
        # the load: another plant in the middle of a cycle
        motion = (0.0, "steps", 3), (1.5, "load", 0.0), (1.5, "stop"), (3.0, "steps", 1)
        with suppress(CommandRefused):  # one that cannot move has nothing more to compile
            for cycles, *command in motion:
                spare.advance(cycles * cycle)
                spare.command(*command)
            spare.advance(3.5 * cycle)
            spare.actuation.halt()  # the chain in the middle of a window
            spare.command("parameters", {"sensor_bandwidth": 1e3})
            spare.advance(3.5 * cycle + 1e-4)

    def take_events(self) -> list[Event]:
        """Return the events since the last call, oldest first, and forget them."""
        events, self._events = self._events, []
        return events

    # -- commands

    def command(self, name: str, *arguments: Any) -> None:
        """Carry out a command of docs/states.md: its name, and its value in SI units if any.

        So ``command("steps", 200)``, ``command("jog", -500.0)`` (Hz), ``command("position", 5e-6)``
        (m), ``command("stop")``, ``command("enable", False)``, ``command("load", 0.1)`` (N),
        ``command("parameters", {"preload": 0.7})``, and ``command("trajectory", ["axis_slider"],
        [(0.5, 1e-6)])``, with points of time from now (s) and measured position (m). Raises
        CommandRefused, and then changes nothing; ParameterError for what is no command.
        """
        command = command_of(name)
        arguments = command.completed(arguments)
        if command.ignored(self, *arguments):
            return
        details = command.details(arguments)
        reason, prepared, more = self._checked(command, arguments)
        if reason:
            raise self.refuse(name, reason, **details)
        self.note(name, "applied", **details, **more, **self._waits(command, arguments))
        with self._solving():
            if command.effect:
                command.effect(self, *prepared)
            elif command.task:
                off = command.turns_off(arguments)
                running = self.closed_loop
                task = None if off else command.task(self, *prepared)
                if task is None or task is not running:
                    self._replace(task, command.breaks_off(*arguments))

    def why_not(self, name: str, *arguments: Any) -> str:
        """Return why a command of the registry would be refused now, empty if it would not."""
        command = command_of(name)
        return self._checked(command, command.completed(arguments))[0]

    if not TYPE_CHECKING:  # for programs of before 3.0.0

        def __getattr__(self, name: str) -> Callable[..., None]:
            """Return the command that had a method: ``command_steps``, ``set_load``, ``stop``."""
            known = name.removeprefix("command_").removeprefix("set_")
            if known not in COMMANDS:
                raise AttributeError(f"an axis has no {name!r}")
            return partial(self.command, known)

    def trip(self, reason: str) -> None:
        """Go into a fault for an external reason, such as a machine that is too slow."""
        self.note(TRIP, "applied", reason=reason)
        with self._solving():
            self._set_fault(reason)

    # -- inside

    def _waits(self, command: Command, arguments: tuple[Any, ...]) -> dict[str, Any]:
        """Return what the event of a command says if the running cycle keeps it waiting."""
        begins = self.actuation.cycle_ends
        waits = command.task or command.name in ("amplitude", "frequency")
        if not waits or command.breaks_off(*arguments) or begins <= self.actuation.t + LONG_WAIT:
            return {}
        return {"begins": begins, "now": STOP_ENDS}

    def _checked(
        self, command: Command, arguments: tuple[Any, ...]
    ) -> tuple[str, tuple[Any, ...], Mapping[str, Any]]:
        """Return why a command is refused, what of it is carried out, more details of its event."""
        reason = refusal(command.row(arguments), self.mode, self.fault)
        if REFUSE in self.config.faults and command.name not in ("parameters", "pause"):
            reason = f"the injected fault {REFUSE} refuses every command"
        if reason:
            return reason, (), {}
        try:
            checked = command.check(self, *arguments)
            prepared = arguments if checked is None else (checked,)
            return "", prepared, command.more_details(*prepared)
        except ParameterError as error:
            return str(error), (), {}


class AxisGroup:
    """The axes of a process by the names of their joints, and their common trajectories.

    All of them take their part of a trajectory or none does, and they end together. Each moves as
    it would alone, so its run repeats from its own events. But it says that the end is reached only
    when all are there.
    """

    def __init__(self, axes: Sequence[Axis]) -> None:
        """Take the axes, which have one time."""
        self._axes = {axis.config.joint: axis for axis in axes}
        self._moves: list[list[tuple[Axis, ClosedLoop]]] = []

    def named(self, joints: Sequence[str]) -> list[Axis]:
        """Return the axes of joints; ParameterError if one is unknown or named twice."""
        for number, joint in enumerate(joints):
            if joint not in self._axes:
                raise ParameterError(f"no joint {joint!r} here; give {', '.join(self._axes)}")
            if joint in joints[:number]:
                raise ParameterError(f"joint {joint} is given twice; give it once")
        if not joints:
            raise ParameterError(f"trajectory for no joint; give some of {', '.join(self._axes)}")
        return [self._axes[joint] for joint in joints]

    def follow(self, parts: Mapping[str, tuple[Any, ...]]) -> None:
        """Let axes follow a trajectory from now on; parts: arguments of its command by joint.

        Raises ParameterError with the reason if one of them refuses; then none moves.
        """
        axes = self.named(list(parts))
        for axis in axes:
            joint = axis.config.joint
            if reason := axis.why_not("trajectory", *parts[joint]):
                raise ParameterError(f"{joint}: {reason}")
        move = []
        for axis in axes:
            axis.command("trajectory", *parts[axis.config.joint])
            if loop := axis.closed_loop:
                loop.waits = True
                move.append((axis, loop))
        self._moves.append(move)

    def end(self) -> None:
        """End the moves whose axes are all there; those that one has left go on alone."""
        for move in list(self._moves):
            still = [loop for axis, loop in move if axis.closed_loop is loop and loop.waits]
            if len(still) < len(move) or all(loop.there for loop in still):
                for loop in still:
                    loop.wait_no_more()
                self._moves.remove(move)
