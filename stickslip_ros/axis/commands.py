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
from typing import TYPE_CHECKING, Any

from stickslip_ros.axis import command as of
from stickslip_ros.axis.command import Command, Row, row
from stickslip_ros.axis.events import WARNED
from stickslip_ros.axis.trajectory import MOST_POINTS, Point, Trajectory
from stickslip_ros.physics.parameters import PARAMETERS, ParameterError, Parameters
from stickslip_ros.physics.parameters.named_files import digests_of

if TYPE_CHECKING:  # who only names commands needs no solver
    from stickslip_ros.axis.device import Device

#: s for which a velocity is kept without renewal: then its commander is assumed dead
_HORIZON = 1.0
#: Share by which two velocities may differ and count as the same: rounding on the way through ROS
_SAME = 1e-9


# -- checks and effects of more than one line


def _task(name: str, *arguments: Any) -> Any:
    """Return a task; what computes is loaded with the first, so that clients do without."""
    return getattr(import_module("stickslip_ros.axis.tasks"), name)(*arguments)


def _check_steps(axis: Device, steps: int) -> None:
    most = axis.parameters.drive.max_steps
    if most is not None and abs(steps) > most:
        raise ParameterError(f"{steps} steps; a command may have at most {most}")


def _check_amplitude(axis: Device, volts: float) -> None:
    for frequency in (axis.config.frequency, *axis.jogs):
        axis.config.check_drive(volts, frequency)
    axis.config.rounded(volts)


def _set_amplitude(axis: Device, volts: float) -> None:
    axis.config.drive(volts, axis.config.frequency)
    axis.actuation.drive_changed()


def _set_frequency(axis: Device, hertz: float) -> None:
    axis.config.drive(axis.config.amplitude, hertz)
    axis.actuation.hertz = None
    axis.actuation.drive_changed()


def _check_trajectory(
    axis: Device, joints: list[str], points: list[Point], begin: float
) -> Trajectory:
    """Return the trajectory from here; ParameterError if it is malformed or leaves the limits."""
    joint = axis.config.joint
    checked: list[Point] = []
    if not 0.0 <= begin < math.inf:
        raise ParameterError(f"trajectory begins in {begin:g} s; this has to be 0 or more")
    if list(joints) != [joint]:
        raise ParameterError(f"trajectory for {', '.join(joints) or 'no joint'}; give {joint} only")
    if len(points) > MOST_POINTS:
        raise ParameterError(
            f"trajectory of {len(points)} points; {MOST_POINTS} is the limit: send it in parts, or "
            "leave points out; the axis moves straight between points"
        )
    if not points:
        raise ParameterError("trajectory without points; give at least one point")
    for number, point in enumerate(points, 1):
        t, x = float(point[0]), float(point[1])
        before = checked[-1][0] if checked else 0.0
        if not (math.isfinite(t) and math.isfinite(x)):
            raise ParameterError(f"point {number} is ({t:g} s, {x:g} m); give finite numbers")
        if t < before or (checked and t == before):
            raise ParameterError(
                f"point {number} is at {t:g} s, not after {before:g} s: times have to increase"
            )
        try:
            axis.config.check_target(x)
        except ParameterError as error:
            raise ParameterError(f"point {number}: {error}") from None
        checked.append((t, x))
    return Trajectory(axis.actuation.t, axis.measured, checked, wait=begin)


def _follow(axis: Device, goal: str, trajectory: Trajectory) -> Any:
    return _task("ClosedLoop", goal, trajectory, axis.step_size, axis.note)


def _follow_trajectory(axis: Device, trajectory: Trajectory) -> Any:
    speeds = axis.speed_of_steps(1), axis.speed_of_steps(-1)
    fastest, lag = trajectory.too_fast(*speeds)
    if lag > axis.config.stroke(axis.config.amplitude):
        then = f"will stay {1e6 * lag:.3g} um behind at times; give it more time, or"
        _warn_of_speed(axis, "trajectory", "trajectory goes at", fastest, speeds, then)
    return _follow(axis, "trajectory", trajectory)


def _warn_of_speed(
    axis: Device, name: str, what: str, v: float, speeds: tuple[float, float], then: str
) -> None:
    """Note that steps, up and down so fast (m/s), do not reach what a command asks for (m/s)."""
    reason = (
        f"the {what} {1e6 * v:.4g} um/s, {1e6 * speeds[v <= 0.0]:.4g} um/s is what steps reach at "
        f"this load: the axis {then} raise frequency or amplitude"
    )
    axis.note(name, WARNED, reason=reason)


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
        v, left = loop.trajectory.velocity_at(axis.actuation.t) if loop else (0.0, math.inf)
        # The same counts as new from half of its time on.
        return math.isclose(value, v, rel_tol=_SAME) and (not value or left > 0.5 * _HORIZON)
    near = axis.parameters.closed_loop.target_tolerance
    if loop:
        return abs(value - loop.trajectory.goal) <= near
    sensor = axis.parameters.sensor
    near = max(near, 6.0 * sensor.sensor_noise + (sensor.sensor_resolution or 0.0))
    return abs(value - axis.measured) <= near


def _check_set_point(axis: Device, joint: str, interface: str, value: float) -> None:
    if interface == "position":
        axis.config.check_target(value)
    elif not math.isfinite(value):
        raise ParameterError(f"velocity is {value:g} m/s; it has to be a finite number")


def _follow_set_point(axis: Device, joint: str, interface: str, value: float) -> Any:
    """Go to a position, or keep a velocity until it is renewed, at most for `_HORIZON`.

    The axis should reach a position when the next one is due, judged by the time since the last:
    controllers send them ten times a second at least.
    """
    loop, t = axis.closed_loop, axis.actuation.t
    start, expires = loop.trajectory.at(t) if loop else axis.measured, math.inf
    speeds = math.inf, math.inf
    if not axis.finishes_cycles and (loop or interface == "velocity"):
        # It may be ahead of the runner by what a tenth of a second of stepping makes up for.
        speeds = axis.speed_of_steps(1), axis.speed_of_steps(-1)
        far = max(speeds) * 0.1 + axis.config.stroke(axis.config.amplitude)
        start = min(max(start, axis.measured - far), axis.measured + far)
    if interface == "position":
        ahead, goal = min(t - loop.trajectory.start, 0.1) if loop else 0.0, value
    else:
        low, high = axis.config.reach
        goal = min(max(start + value * _HORIZON, low), high)
        ahead = (goal - start) / value if value else 0.0
        expires = math.inf if axis.finishes_cycles else t + _HORIZON
        before = loop.trajectory.velocity_at(t)[0] if loop else math.nan
        new = not math.isclose(value, before, rel_tol=_SAME)  # it is said once of a velocity
        if new and not -speeds[1] <= value <= speeds[0]:
            then = "goes so fast;"
            _warn_of_speed(axis, "joint_command", "velocity is", value, speeds, then)
    trajectory = Trajectory(t, start, [(ahead, goal)]) if ahead > 0.0 else Trajectory(t, goal, [])
    trajectory.expires = expires
    if loop is None:
        return _follow(axis, "target", trajectory)
    loop.follow(trajectory)
    return loop


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
    """Set out for the reference: there, what was counted before, by `zero`, is forgotten."""

    def note(*event: str, **details: float) -> None:
        axis.note(*event, **details)
        axis.config.offset = 0.0

    limits = axis.parameters.limits
    if limits.home != "mark":
        return _task("EndTask", limits.home == "high", note)
    mark = Trajectory(axis.actuation.t, limits.home_mark - axis.config.offset, [])
    return _task("ClosedLoop", "home", mark, axis.step_size, note)


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
    return (-most, most) if most else (-of.INT32_RANGE, of.INT32_RANGE - 1)


#: In every state.
_ALWAYS = row(of.SAME, fault=of.SAME, disabled=of.SAME)

COMMANDS: dict[str, Command] = {
    command.name: command
    for command in (
        # Of commands that wait together the drive is set before the steps are begun.
        Command(
            "amplitude",
            of.FLOAT64,
            "peak to peak, from the next cycle on",
            row(of.SAME),
            example=(250.0,),
            check=_check_amplitude,
            effect=_set_amplitude,
            unit="V",
            limits=lambda axis: (0.0, axis.parameters.actuator.max_voltage),
        ),
        Command(
            "frequency",
            of.FLOAT64,
            "of stepping, from the next cycle on; the slip has to fit into the cycle",
            row(of.SAME),
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
            of.WRENCH,
            "external force along the axis; the other components are not used",
            _ALWAYS,
            example=(1e-3,),
            field="wrench.force.x",
            check=lambda _, newtons: replace(PARAMETERS["force"], name="load").check(newtons),
            effect=_set_load,
            unit="N",
            limits=lambda axis: (PARAMETERS["force"].low, PARAMETERS["force"].high),
        ),
        Command(
            "steps",
            of.INT32,
            "number of steps, the sign is the direction; 0 finishes the cycle and stops",
            row(of.STEPPING),
            example=(100_000,),
            off=("steps 0", row(of.STOPPED)),
            check=_check_steps,
            task=lambda axis, steps: _task("StepTask", steps),
            limits=_most_steps,
        ),
        Command(
            "jog",
            of.FLOAT64,
            "steps without end, the sign is the direction; 0 stops",
            row(of.JOGGING),
            example=(-700.0,),
            off=("jog 0", row(of.STOPPED)),
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
            of.FLOAT64,
            "level to which the actuator moves slowly, without a slip",
            row(of.SCANNING),
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
            of.FLOAT64,
            "target position; the closed loop with the simulated sensor goes there and holds it",
            row(of.TARGETING),
            example=(1e-3,),
            check=lambda axis, x: axis.config.check_target(x),
            task=lambda axis, x: _follow(axis, "target", Trajectory(axis.actuation.t, x, [])),
            unit="m",
            limits=lambda axis: axis.config.reach,
        ),
        Command(
            "trajectory",
            of.TRAJECTORY,
            "points (s, m) that the closed loop follows; it holds the last",
            row(of.TARGETING),
            "joint_trajectory",
            example=(["axis_slider"], [(5.0, 1e-5)]),
            arguments=("joints", "points", "begin"),
            defaults=(0.0,),
            check=_check_trajectory,
            task=_follow_trajectory,
        ),
        Command(
            "joint_command",
            of.JOINT_STATE,
            "set point of a controller of ROS, position (m) or velocity (m/s), in closed loop",
            row(of.TARGETING),
            "joint_commands",
            example=("axis_slider", "position", 1e-3),
            arguments=("joint", "interface", "value"),
            ignored=_is_old_set_point,
            check=_check_set_point,
            task=_follow_set_point,
            depth=1,
        ),
        Command(
            "home",
            of.TRIGGER,
            "go to the reference, a mark or an end of the travel; positions count from it then",
            row(of.HOMING),
            arguments=(),
            check=_check_home,
            task=_go_home,
        ),
        Command(
            "stop",
            of.TRIGGER,
            "end the running command within 20 ms: a longer cycle is broken off",
            row(of.STOPPED, fault=of.SAME, disabled=of.SAME),
            arguments=(),
            breaks_off=lambda: True,
            task=lambda axis: None,
        ),
        Command(
            "reset",
            of.TRIGGER,
            "leave a fault",
            row(of.SAME, fault=of.STOPPED, disabled=of.SAME),
            arguments=(),
            check=_check_reset,
            effect=lambda axis: axis.clear_fault(),
        ),
        Command(
            "zero",
            of.TRIGGER,
            "count positions from the present reading of the sensor on",
            row(of.REFUSED, stopped=of.SAME),
            arguments=(),
            check=_check_zero,
            effect=_zero,
        ),
        Command(
            "enable",
            of.SET_BOOL,
            "accept commands, or refuse them; disabling ends the running command as stop does",
            row(of.SAME, fault=of.SAME, disabled=of.STOPPED),
            example=(True,),
            defaults=(True,),
            off=("disable", row(of.DISABLED, fault=of.DISABLED, disabled=of.SAME)),
            effect=lambda axis, on: axis.set_enabled(on),
        ),
        Command(
            "pause",
            of.SET_BOOL,
            "pause the time of all axes of the process, or continue",
            _ALWAYS,
            example=(True,),
            defaults=(True,),
            effect=_pause,
        ),
        Command(
            "parameters",
            of.SET_PARAMETERS,
            "change parameters, all or none",
            _ALWAYS,
            "set_parameters_atomically",
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
