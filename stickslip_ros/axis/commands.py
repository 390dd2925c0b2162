# SPDX-License-Identifier: Apache-2.0
"""Every command of an axis, each defined once: name, message, arguments, check, states, effect.

Everything else that deals with commands reads this registry: `Axis.command`, the table of states,
the subscriptions and services of the node, its description, the client, the recorder's topics, the
events and their repetition. A new command is one more entry in `COMMANDS`.
"""

from __future__ import annotations

import math
from dataclasses import replace
from importlib import import_module
from numbers import Integral
from typing import TYPE_CHECKING, Any

from stickslip_ros.axis.command import (
    DISABLED,
    FLOAT64,
    HOMING,
    INT32,
    INT32_RANGE,
    JOGGING,
    JOINT_STATE,
    REFUSED,
    SAME,
    SCANNING,
    SET_BOOL,
    SET_PARAMETERS,
    STEPPING,
    STOPPED,
    TARGETING,
    TRAJECTORY,
    TRIGGER,
    WRENCH,
    Command,
    Row,
    row,
)
from stickslip_ros.axis.events import WARNED, digests_of
from stickslip_ros.axis.trajectory import Point, Trajectory, check_trajectory
from stickslip_ros.physics.parameters import PARAMETERS, ParameterError, Parameters

if TYPE_CHECKING:  # who only names commands needs no solver
    from stickslip_ros.axis.closed_loop import ClosedLoop
    from stickslip_ros.axis.device import Device

#: s for which a velocity is kept without renewal: then its commander is assumed dead
_HORIZON = 1.0
#: s between two positions of one motion: controllers send them ten times a second at least
_LONGEST_PERIOD = 0.1
#: s before the horizon, from when on the same velocity counts as new
_RENEWED = 0.5
#: s of stepping by which a set point may be ahead of the runner when the next one comes
_AHEAD = 0.1
#: Share by which two velocities may differ and count as the same: rounding on the way through ROS
_SAME = 1e-9


# -- checks and effects of more than one line


def _task(name: str, *arguments: Any) -> Any:
    """Return a task; what computes is loaded with the first, so that clients do without."""
    return getattr(import_module("stickslip_ros.axis.tasks"), name)(*arguments)


def _loop(axis: Device, goal: str, trajectory: Trajectory) -> ClosedLoop:
    loop: ClosedLoop = _task("ClosedLoop", goal, trajectory, axis.step_size, axis.note)
    return loop


def _check_steps(axis: Device, steps: int) -> None:
    low, high = _most_steps(axis)
    given: object = steps
    if isinstance(given, bool) or not isinstance(given, Integral):
        raise ParameterError(
            f"{steps!r} steps; a command takes a whole number from {low} to {high}: round it"
        )
    most = axis.parameters.drive.max_steps
    if most is not None and abs(steps) > most:
        raise ParameterError(f"{steps} steps; a command may have at most {most}")


def _check_amplitude(axis: Device, volts: float) -> None:
    for frequency in (axis.config.frequency, *axis.jogs):
        axis.config.check_drive(volts, frequency)
    axis.config.rounded("amplitude", volts)


def _set_amplitude(axis: Device, volts: float) -> None:
    axis.config.drive(volts, axis.config.frequency)
    axis.actuation.drive_changed()


def _set_frequency(axis: Device, hertz: float) -> None:
    axis.config.drive(axis.config.amplitude, hertz)
    axis.actuation.hertz = None
    axis.actuation.drive_changed()


def _check_points(
    axis: Device, joints: list[str], points: list[Point], begin: float
) -> tuple[list[Point], float]:
    if not 0.0 <= begin < math.inf:
        raise ParameterError(f"trajectory begins in {begin:g} s; this has to be 0 or more")
    config = axis.config
    return check_trajectory(joints, points, config.joint, config.check_target), begin


def _follow_points(axis: Device, checked: tuple[list[Point], float]) -> ClosedLoop:
    points, begin = checked
    trajectory = Trajectory(axis.actuation.t, axis.measured, points, wait=begin)
    up, down = axis.speed_of_steps(1), axis.speed_of_steps(-1)
    fastest, lag = trajectory.too_fast(up, down)
    stroke = axis.config.stroke(axis.config.amplitude)
    if lag > stroke:
        reached = up if fastest > 0.0 else down
        reason = (
            f"the trajectory goes at {1e6 * fastest:.4g} um/s, {1e6 * reached:.4g} um/s is what "
            f"steps reach at this load: the axis will stay {1e6 * lag:.3g} um behind at times; "
            "give it more time, or raise frequency or amplitude"
        )
        axis.note("trajectory", WARNED, reason=reason)
    return _loop(axis, "trajectory", trajectory)


def _is_old_set_point(axis: Device, joint: str, interface: str, value: float) -> bool:
    """Return True for a set point of another joint, of no value, or at the present target.

    Controllers repeat their set points, and some send back the position that they read. If each
    reading became the next target, the noise of the sensor would carry the axis away. Readings
    differ by six times their noise, and by their resolution.
    """
    if joint != axis.config.joint or math.isnan(value):
        return True
    loop = axis.closed_loop
    if loop is None and axis.moving:
        return False
    if interface == "velocity":
        velocity, left = (
            (0.0, math.inf) if loop is None else loop.trajectory.velocity_at(axis.actuation.t)
        )
        return math.isclose(value, velocity, rel_tol=_SAME) and (not value or left > _RENEWED)
    goal, near = axis.measured, axis.config.parameters.closed_loop.target_tolerance
    if loop:
        goal = loop.trajectory.goal
    else:
        sensor = axis.config.parameters.sensor
        near = max(near, 6.0 * sensor.sensor_noise + (sensor.sensor_resolution or 0.0))
    return abs(value - goal) <= near


def _check_set_point(axis: Device, joint: str, interface: str, value: float) -> None:
    if interface == "position":
        axis.config.check_target(value)
    elif not math.isfinite(value):
        raise ParameterError(f"velocity is {value:g} m/s; it has to be a finite number")


def _follow_set_point(axis: Device, joint: str, interface: str, value: float) -> ClosedLoop:
    """Go to a position, or keep a velocity until it is renewed, at most for `_HORIZON`.

    The axis should reach a position when the next one is due, judged by the time since the last.
    """
    loop, t = axis.closed_loop, axis.actuation.t
    start = loop.trajectory.at(t) if loop else axis.measured
    up = down = math.inf
    if not axis.finishes_cycles and (loop or interface == "velocity"):
        up, down = axis.speed_of_steps(1), axis.speed_of_steps(-1)
        stroke = axis.config.stroke(axis.config.amplitude)
        far = max(up, down) * _AHEAD + stroke
        start = min(max(start, axis.measured - far), axis.measured + far)
    lasts = math.inf
    if interface == "position":
        ahead, goal = min(t - loop.trajectory.start, _LONGEST_PERIOD) if loop else 0.0, value
    else:
        low, high = axis.config.reach
        goal = min(max(start + value * _HORIZON, low), high)
        ahead = (goal - start) / value if value else 0.0
        lasts = math.inf if axis.finishes_cycles else _HORIZON
        _warn_of_velocity(axis, loop, value, up, down)
    if ahead <= 0.0:
        start = goal
    points = [(ahead, goal)] if ahead > 0.0 else []
    trajectory = Trajectory(t, start, points, lasts=lasts)
    if loop is None:
        return _loop(axis, "target", trajectory)
    loop.follow(trajectory)
    return loop


def _warn_of_velocity(
    axis: Device, loop: ClosedLoop | None, value: float, up: float, down: float
) -> None:
    """Say once of a velocity (m/s) that steps, up and down at most so fast, do not reach it."""
    before = loop.trajectory.velocity_at(axis.actuation.t)[0] if loop else math.nan
    if -down <= value <= up or math.isclose(value, before, rel_tol=_SAME):
        return
    reached = up if value > 0.0 else down
    reason = (
        f"the velocity is {1e6 * value:.4g} um/s, {1e6 * reached:.4g} um/s is what steps reach at "
        "this load: the axis goes so fast; raise frequency or amplitude"
    )
    axis.note("joint_command", WARNED, reason=reason)


def _go_to(axis: Device, x: float) -> ClosedLoop:
    return _loop(axis, "target", Trajectory(axis.actuation.t, x, []))


def _check_home(axis: Device) -> None:
    """Raise ParameterError where limits leave the reference out of reach."""
    limits, offset = axis.parameters.limits, axis.config.offset
    if limits.home == "mark":
        axis.config.check_target(limits.home_mark - offset)
        return
    low = limits.home == "low"
    end = limits.travel_low if low else limits.travel_high
    soft = (limits.soft_low if low else limits.soft_high) + offset
    if soft > end if low else soft < end:
        raise ParameterError(
            f"soft_{limits.home} is {soft - offset:g} m, and the {limits.home} end of the travel, "
            f"which is home, lies at {end - offset:g} m: set soft_{limits.home} beyond it"
        )


def _go_home(axis: Device) -> Any:
    homing, where = import_module("stickslip_ros.axis.homing"), axis.parameters.limits.home
    if where == "mark":
        return homing.MarkTask(axis.config, axis.actuation.t, axis.step_size, axis.note)
    return homing.EndTask(1 if where == "high" else -1, axis.note)


def _set_load(axis: Device, newtons: float) -> None:
    axis.actuation.set_load(newtons)
    axis.supervisor.task_began(axis.actuation)


def _check_reset(axis: Device) -> None:
    if not math.isfinite(axis.actuation.x):
        raise ParameterError("the solver has lost the state of the axis: start the node anew")


def _check_zero(axis: Device) -> None:
    if math.isnan(axis.measured):
        raise ParameterError("the sensor gives no reading to count from")


def _zero(axis: Device) -> None:
    axis.config.offset += axis.measured


def _set_parameters(axis: Device, new: Parameters) -> None:
    old = axis.parameters
    if replace(new, node=old.node) == old:
        axis.config.parameters = new
        return
    axis.config.apply(new)
    moving = axis.take_faults()
    # Of what the sensor does the motion knows nothing: it stays the same to the last bit.
    if moving or replace(new, node=old.node, sensor=old.sensor, faults=old.faults) != old:
        axis.actuation.change_later()


def _pause(axis: Device, on: bool) -> None:
    axis.paused = on


def _most_steps(axis: Device) -> tuple[float, float]:
    most = axis.parameters.drive.max_steps
    return (-most, most) if most else (-INT32_RANGE, INT32_RANGE - 1)


#: In every state.
_ALWAYS = row(SAME, fault=SAME, disabled=SAME)

COMMANDS: dict[str, Command] = {
    command.name: command
    for command in (
        # Of commands that wait together the drive is set before the steps are begun.
        Command(
            "amplitude",
            "command/amplitude",
            FLOAT64,
            "peak to peak, from the next cycle on",
            row(SAME),
            example=(250.0,),
            check=_check_amplitude,
            effect=_set_amplitude,
            unit="V",
            limits=lambda axis: (0.0, axis.parameters.actuator.max_voltage),
        ),
        Command(
            "frequency",
            "command/frequency",
            FLOAT64,
            "of stepping, from the next cycle on; the slip has to fit into the cycle",
            row(SAME),
            example=(900.0,),
            check=lambda axis, hertz: axis.config.check_drive(axis.config.amplitude, hertz),
            effect=_set_frequency,
            unit="Hz",
            limits=lambda axis: (
                axis.parameters.drive.min_frequency,
                axis.parameters.drive.max_frequency,
            ),
        ),
        Command(
            "load",
            "load",
            WRENCH,
            "external force along the axis; the other components are not used",
            _ALWAYS,
            example=(1e-3,),
            field="wrench.force.x",
            check=lambda axis, newtons: axis.config.check_load(newtons),
            effect=_set_load,
            unit="N",
            limits=lambda axis: (PARAMETERS["force"].low, PARAMETERS["force"].high),
        ),
        Command(
            "steps",
            "command/steps",
            INT32,
            "number of steps, the sign is the direction; 0 finishes the cycle and stops",
            row(STEPPING),
            example=(100_000,),
            off=("steps 0", row(STOPPED)),
            check=_check_steps,
            task=lambda axis, steps: _task("StepTask", steps),
            limits=_most_steps,
        ),
        Command(
            "jog",
            "command/jog",
            FLOAT64,
            "steps without end, the sign is the direction; 0 stops",
            row(JOGGING),
            example=(-700.0,),
            off=("jog 0", row(STOPPED)),
            breaks_off=lambda hertz: not hertz,
            check=lambda axis, hertz: axis.config.check_drive(
                axis.config.amplitude, abs(hertz) or axis.config.frequency
            ),
            task=lambda axis, hertz: _task("JogTask", hertz),
            unit="Hz",
            limits=lambda axis: (
                -axis.parameters.drive.max_frequency,
                axis.parameters.drive.max_frequency,
            ),
        ),
        Command(
            "scan",
            "command/scan",
            FLOAT64,
            "level to which the actuator moves slowly, without a slip",
            row(SCANNING),
            example=(200.0,),
            check=lambda axis, volts: axis.config.check_level(volts),
            task=lambda axis, volts: _task("ScanTask", axis.config.nearest(volts), axis.note_limit),
            breaks_off=lambda volts: True,
            unit="V",
            limits=lambda axis: (
                axis.parameters.actuator.min_voltage,
                axis.parameters.actuator.max_voltage,
            ),
        ),
        Command(
            "position",
            "command/position",
            FLOAT64,
            "target position; the closed loop with the simulated sensor goes there and holds it",
            row(TARGETING),
            example=(1e-3,),
            check=lambda axis, x: axis.config.check_target(x),
            task=_go_to,
            unit="m",
            limits=lambda axis: axis.config.reach,
        ),
        Command(
            "trajectory",
            "joint_trajectory",
            TRAJECTORY,
            "points (s, m) that the closed loop follows; it holds the last",
            row(TARGETING),
            example=(["axis_slider"], [(5.0, 1e-5)]),
            arguments=("joints", "points", "begin"),
            defaults=(0.0,),
            check=_check_points,
            task=_follow_points,
        ),
        Command(
            "joint_command",
            "joint_commands",
            JOINT_STATE,
            "set point of a controller of ROS, position (m) or velocity (m/s), in closed loop",
            row(TARGETING),
            example=("axis_slider", "position", 1e-3),
            arguments=("joint", "interface", "value"),
            ignored=_is_old_set_point,
            check=_check_set_point,
            task=_follow_set_point,
            depth=1,
        ),
        Command(
            "home",
            "home",
            TRIGGER,
            "go to the reference, a mark or an end of the travel; positions count from it then",
            row(HOMING),
            arguments=(),
            check=_check_home,
            task=_go_home,
        ),
        Command(
            "stop",
            "stop",
            TRIGGER,
            "end the running command within 20 ms: a longer cycle is broken off",
            row(STOPPED, fault=SAME, disabled=SAME),
            arguments=(),
            breaks_off=lambda: True,
            task=lambda axis: None,
        ),
        Command(
            "reset",
            "reset",
            TRIGGER,
            "leave a fault",
            row(SAME, fault=STOPPED, disabled=SAME),
            arguments=(),
            check=_check_reset,
            effect=lambda axis: axis.clear_fault(),
        ),
        Command(
            "zero",
            "zero",
            TRIGGER,
            "count positions from the present reading of the sensor on",
            row(REFUSED, stopped=SAME),
            arguments=(),
            check=_check_zero,
            effect=_zero,
        ),
        Command(
            "enable",
            "enable",
            SET_BOOL,
            "accept commands, or refuse them; disabling ends the running command as stop does",
            row(SAME, fault=SAME, disabled=STOPPED),
            example=(True,),
            defaults=(True,),
            off=("disable", row(DISABLED, fault=DISABLED, disabled=SAME)),
            effect=lambda axis, on: axis.set_enabled(on),
        ),
        Command(
            "pause",
            "pause",
            SET_BOOL,
            "pause the time of all axes of the process, or continue",
            _ALWAYS,
            example=(True,),
            defaults=(True,),
            effect=_pause,
        ),
        Command(
            "parameters",
            "set_parameters_atomically",
            SET_PARAMETERS,
            "change parameters, all or none",
            _ALWAYS,
            example=({"payload": 1e-4},),
            arguments=None,
            check=lambda axis, changes: axis.checked(changes),
            effect=_set_parameters,
            more_details=digests_of,
        ),
    )
}


def command_of(name: str) -> Command:
    """Return the command of that name; ParameterError if there is none."""
    if name not in COMMANDS:
        raise ParameterError(f"there is no command {name!r}; there are {', '.join(COMMANDS)}")
    return COMMANDS[name]


def state_table() -> dict[str, Row]:
    """Return the effect of every command in every state, by its name in the table of states."""
    return {name: row for command in COMMANDS.values() for name, row in command.rows().items()}
