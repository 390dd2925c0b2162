# SPDX-License-Identifier: Apache-2.0
"""Waveforms. A new one is a function from parameters to a `Shape` and a line in WAVEFORMS.

A function is arithmetic on parameters, written once for an operating point and for columns of
many: numbers in the parameters may be arrays.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.model.actuator import Actuator
from stickslip_ros.model.actuator_chain import (
    Chain,
    has_chain,
    has_dynamics,
    settled,
    without_chain,
)
from stickslip_ros.model.drive_cycle import DriveCycle, DriveCycles, ramp, stacked, through
from stickslip_ros.model.waveforms.built_in import (
    PER_MICROSECOND,
    hold_shape,
    no_time,
    sawtooth_shape,
    shaped_shape,
    triangle_shape,
)
from stickslip_ros.model.waveforms.shape import Rows, Shape
from stickslip_ros.model.waveforms.table import table_shape
from stickslip_ros.parameters import DriveParameters, ParameterError, Parameters, parameter

WAVEFORMS: Mapping[str, Callable[[DriveParameters], Shape]] = {
    "sawtooth": sawtooth_shape,
    "hold": hold_shape,
    "shaped": shaped_shape,
    "triangle": triangle_shape,
    "table": table_shape,
}

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
]


def shape_of(d: DriveParameters) -> Shape:
    """Return the shape of the waveform that the parameters name; ParameterError if none."""
    try:
        waveform = WAVEFORMS[d.waveform]
    except KeyError:
        raise ParameterError(f"waveform is {d.waveform!r}; known: {', '.join(WAVEFORMS)}") from None
    return waveform(d)


def drive_of(p: Parameters, sign: int = 1) -> DriveCycle:
    """Return the drive cycle that the parameters describe; ParameterError if they contradict.

    sign -1 mirrors it (the paper's "sign of the amplitude"): the runner steps to -x. An actuator
    with a memory, a lag or a resonance runs the loop that it settles to, without creep.
    """
    d = p.drive
    limits = {"max_voltage": p.actuator.max_voltage, "max_frequency": d.max_frequency}
    for (limit, high), name in zip(limits.items(), ("amplitude", "frequency"), strict=True):
        row = replace(parameter(name), high=high, reason=f"lower it, or raise {limit}")
        row.check(getattr(d, name))
    actuator, shape = Actuator.of(p.actuator), shape_of(d)
    if has_dynamics(p.actuator):
        return settled(
            Chain.of(p.actuator, creeping=False), _drive_cycle(d, shape, p.actuator.gain, sign)
        )
    if actuator.is_linear:
        return _drive_cycle(d, shape, p.actuator.gain, sign)
    voltage = _drive_cycle(d, shape, 1.0, sign)
    return through(actuator, sign * shape.start * d.amplitude, voltage)


def command_of(p: Parameters, sign: int = 1) -> DriveCycle:
    """Return the drive cycle to start a `solver.simulation_of` the parameters with.

    That of `drive_of`, unless the actuator follows its command in time: then the command, which is
    gain by voltage. Raises ParameterError.
    """
    if not has_chain(p.actuator):
        return drive_of(p, sign)
    return drive_of(replace(p, actuator=without_chain(p.actuator)), sign)


def drives_of(p: Parameters, points: int, sign: int) -> tuple[DriveCycles, NDArray[np.bool_]]:
    """Return the drive cycles of many operating points and which of them are possible, (points,).

    Numbers in p may be arrays of shape (points,). Each possible row is as `drive_of` makes it.
    """
    amplitude, frequency = np.full(points, p.drive.amplitude), np.full(points, p.drive.frequency)
    columns: dict[str, Any] = {"amplitude": amplitude, "frequency": frequency}
    rows = shape_of(replace(p.drive, **columns)).rows(points)
    possible = rows.possible & (amplitude <= p.actuator.max_voltage)
    possible &= frequency <= p.drive.max_frequency
    if p.actuator.actuator == "linear" and not has_dynamics(p.actuator):
        return _drive_cycles(rows, sign * p.actuator.gain * amplitude, sign), possible
    one_by_one = (drive_of(p.point(k), sign) if possible[k] else None for k in range(points))
    return stacked(list(one_by_one), sign), possible


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
    rows = shape.rows(1)
    if not rows.possible[0]:
        raise ParameterError(no_time(d, shape))
    return _drive_cycles(rows, sign * gain * d.amplitude, sign).row(0)


def _drive_cycles(rows: Rows, stroke: Any, sign: int) -> DriveCycles:
    """Return the drive cycles of rows; stroke is the full deflection (m), a number or (points,)."""
    ways = rows.changes * np.reshape(stroke, (-1, 1))
    used = rows.durations != 0.0
    rates = np.divide(ways, rows.durations, out=np.zeros_like(ways), where=used)
    return DriveCycles(rows.durations, rates, rows.slip, sign, rows.slip_parts)
