# SPDX-License-Identifier: Apache-2.0
"""The drive cycles that waveform and actuator make, of one operating point or of many."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.base.arrays import Array
from stickslip_ros.physics.model.actuator import Actuator
from stickslip_ros.physics.model.actuator_chain import (
    Chain,
    has_chain,
    has_dynamics,
    without_chain,
)
from stickslip_ros.physics.model.actuator_stages import settled
from stickslip_ros.physics.model.drive_cycle import (
    DriveCycle,
    DriveCycles,
    deflect,
    ramp,
    stack_cycles,
)
from stickslip_ros.physics.parameters import DriveParameters, ParameterError, Parameters, parameter
from stickslip_ros.physics.parameters.extensions import named_in_errors
from stickslip_ros.physics.waveforms import WAVEFORMS, Shape
from stickslip_ros.physics.waveforms.built_in import PER_MICROSECOND, sawtooth_shape, slip_too_long

__all__ = [
    "WAVEFORMS",
    "DriveCycle",
    "DriveCycles",
    "Shape",
    "command_of",
    "drive_of",
    "drives_of",
    "largest_slip",
    "ramp",
    "sawtooth",
    "shape_of",
    "voltage_of",
]


def shape_of(d: DriveParameters) -> Shape:
    """Return the shape of the waveform that the parameters name; ParameterError if none."""
    try:
        waveform = WAVEFORMS[d.waveform]
    except KeyError:
        raise ParameterError(
            f"waveform is {d.waveform!r}; known: {', '.join(WAVEFORMS)}; one of your own needs "
            "register_waveform in this process, or the entry points stickslip_ros.waveforms of a "
            "package"
        ) from None
    with named_in_errors(f"the waveform {d.waveform}", waveform):
        shape = waveform(d)
        if not isinstance(shape, Shape):
            raise TypeError(f"it returns {shape!r}, not a stickslip_ros.Shape")
    return shape


def drive_of(p: Parameters, sign: int = 1) -> DriveCycle:
    """Return the drive cycle that the parameters describe; ParameterError if they contradict.

    sign -1 mirrors it (the paper's "sign of the amplitude"): the runner steps to -x. An actuator
    with a memory, a lag or a resonance runs the loop that it settles to, without creep.
    """
    d = p.drive
    limits = {"max_voltage": p.actuator.max_voltage, "max_frequency": d.max_frequency}
    for (limit, high), name in zip(limits.items(), ("amplitude", "frequency"), strict=True):
        value = getattr(d, name)
        cure = f"lower it, or raise {limit}" if value > high else "raise it"
        replace(parameter(name), high=high, reason=cure).check(value)
    actuator, shape = Actuator.of(p.actuator), shape_of(d)
    if has_dynamics(p.actuator):
        return settled(
            Chain.of(p, creeping=False), _drive_cycle(d, shape, p.actuator.gain_in_force, sign)
        )
    if actuator.is_linear:
        return _drive_cycle(d, shape, p.actuator.gain_in_force, sign)
    voltage = voltage_of(d, sign)
    loop = deflect(actuator, sign * shape.start * d.amplitude, voltage)
    return replace(loop, commanded=p.actuator.gain_in_force * voltage.slip_rate)


def command_of(p: Parameters, sign: int = 1) -> DriveCycle:
    """Return the drive cycle to start a `solver.simulation_of` the parameters with.

    That of `drive_of`, unless the actuator follows its command in time: then the command, which is
    gain by voltage. Raises ParameterError.
    """
    if not has_chain(p.actuator):
        return drive_of(p, sign)
    return drive_of(replace(p, actuator=without_chain(p.actuator)), sign)


def voltage_of(d: DriveParameters, sign: int = 1) -> DriveCycle:
    """Return the cycle of the voltage: rates in V/s, from the level at which it begins."""
    return _drive_cycle(d, shape_of(d), 1.0, sign)


def drives_of(p: Parameters, points: int, sign: int) -> tuple[DriveCycles, NDArray[np.bool_]]:
    """Return the drive cycles of many operating points and which of them are possible, (points,).

    Numbers in p may be arrays of shape (points,). Each possible row is as `drive_of` makes it.
    """
    amplitude, frequency = np.full(points, p.drive.amplitude), np.full(points, p.drive.frequency)
    columns: dict[str, Any] = {"amplitude": amplitude, "frequency": frequency}
    d = replace(p.drive, **columns)
    cycles, possible = _cycles_of(shape_of(d), sign * p.actuator.gain_in_force * amplitude, sign)
    possible &= (amplitude <= p.actuator.max_voltage) & (frequency <= d.max_frequency)
    if p.actuator.actuator == "linear" and not has_dynamics(p.actuator):
        return cycles, possible
    one_by_one = (drive_of(p.point(k), sign) if possible[k] else None for k in range(points))
    return stack_cycles(list(one_by_one), sign), possible


def sawtooth(
    amplitude: float, frequency: float, slewrate: float, gain: float, sign: int = 1
) -> DriveCycle:
    """Return the sawtooth of four parameters (section 2, Fig. 2).

    amplitude V peak to peak, frequency Hz, slewrate of the slip V/us, gain of the actuator m/V.
    Raises ParameterError if the period leaves no time beside the slip.
    """
    d = DriveParameters(amplitude=amplitude, frequency=frequency, slewrate=slewrate)
    return _drive_cycle(d, sawtooth_shape(d), gain, sign)


def largest_slip(d: DriveParameters) -> Any:
    """Return the amplitude (V) whose slip would take all the time that the waveform leaves it.

    Infinite where the slewrate plays no part; numbers in d may be arrays.
    """
    return d.slewrate * PER_MICROSECOND * shape_of(d).time_for_slip


def _drive_cycle(d: DriveParameters, shape: Shape, gain: float, sign: int) -> DriveCycle:
    cycles, possible = _cycles_of(shape, np.array([sign * gain * d.amplitude]), sign)
    if not possible[0]:
        raise ParameterError(slip_too_long(d, shape))
    return cycles.row(0)


def _cycles_of(shape: Shape, strokes: Array, sign: int) -> tuple[DriveCycles, NDArray[np.bool_]]:
    """Return the shape as drive cycles of strokes (m), (points,), and which are possible.

    Segments of no time are left out: rows are filled with durations of 0 at the end.
    """
    points = len(strokes)
    durations, changes = _columns(shape.durations, points), _columns(shape.changes, points)
    possible = ~((durations < 0.0) | ((durations == 0.0) & (changes != 0.0))).any(axis=1)
    first, stop = shape.slip
    lasts = durations > 0.0
    falls = lasts & (changes < 0.0)
    falls[:, :first] = falls[:, stop:] = False
    index = np.cumsum(lasts, axis=1) - 1  # where each segment comes to stand
    # The slip goes from the segment in which the level begins to fall to that where it last falls.
    slip = np.take_along_axis(index, np.argmax(falls, axis=1)[:, None], axis=1)[:, 0]
    end = np.where(falls, index, -1).max(axis=1)
    if not lasts.all():
        order = np.argsort(~lasts, axis=1, kind="stable")
        durations = np.take_along_axis(np.where(lasts, durations, 0.0), order, axis=1)
        changes = np.take_along_axis(np.where(lasts, changes, 0.0), order, axis=1)
    lengths = changes * strokes[:, None]
    rates = np.divide(lengths, durations, out=np.zeros_like(lengths), where=durations != 0.0)
    return DriveCycles(durations, rates, slip, sign, end - slip + 1), possible


def _columns(values: tuple[Any, ...], points: int) -> Array:
    """Return values, numbers or arrays (points,), as (points, values)."""
    if any(isinstance(value, np.ndarray) for value in values):
        return np.stack([np.broadcast_to(np.asarray(one, float), points) for one in values], axis=1)
    return np.tile(np.array(values, float), (points, 1))
