# SPDX-License-Identifier: Apache-2.0
"""Many axes side by side, each with its own parameters, run period by period.

An axis here is the model with a sensor, without commands, tasks and limits of a controller: what
drives it is a policy. Each starts from rest at 0.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.arrays import Array
from stickslip_ros.axis.sensor import Sensor, has_bandwidth
from stickslip_ros.compiled import report_compilation
from stickslip_ros.gym.periods import (
    AMPLITUDE,
    FREQUENCY,
    PLACE,
    SLEWRATE,
    ActionScale,
    Buffers,
    Sensing,
    States,
    read,
    run_periods,
)
from stickslip_ros.laws import OWN_CONSTANTS
from stickslip_ros.laws.law import Contact
from stickslip_ros.model import Plant
from stickslip_ros.model.actuator import Actuator
from stickslip_ros.model.actuator_chain import Chain, has_chain, limits_of_pieces
from stickslip_ros.model.friction import is_defined
from stickslip_ros.model.surface import Surface
from stickslip_ros.parameters import ParameterError, Parameters, parameter
from stickslip_ros.solver import SolverError
from stickslip_ros.solver.layout import (
    CONTACT_RECORD,
    CONTACT_SIZE,
    KERNEL_SIZE,
    PLANT,
    PLANT_SIZE,
    STATE,
    plain_dtype,
)
from stickslip_ros.solver.plants import at_rest, derive_constants

Columns = Mapping[str, Array]  #: values of parameters by name, (axes,)

#: V/us to V/s
_PER_MICROSECOND = 1e6
#: Share of a period that its fast part may take, so that the slow part is the slow one
_FASTEST = 0.5
#: What each axis may have for itself: groups of parameters, and those of its sensor
_OWN_GROUPS, _OWN_OF_SENSOR = ("friction", "runner"), ("sensor_noise", "sensor_drift")
#: Strokes that an actuator with a resonance moves at most in a piece
_OVERSHOOT = 2.0
#: Axes that are worth a thread of their own
_WORTH_A_THREAD = 64


@dataclass(frozen=True)
class DriveRanges:
    """What an action may ask for; its numbers, -1 to 1, span these ranges."""

    frequency: tuple[float, float] = (100.0, 10e3)  #: of a drive cycle, Hz
    slewrate: tuple[float, float] = (10.0, 100.0)  #: of the slip, V/us
    #: s, duration of a sample: an action is one voltage then; None: it is one drive cycle
    sample: float | None = None

    def drive(self, p: Parameters) -> ActionScale:
        """Return the ranges as the kernel takes them; ParameterError if they contradict p."""
        slow, fast = (_PER_MICROSECOND * one for one in self.slewrate)
        low, high = p.actuator.min_voltage, p.actuator.max_voltage
        period = self.sample or 1.0 / self.frequency[1]
        fall = (high - low) / (fast if self.sample else slow)
        rising = self.frequency[0] <= self.frequency[1] and slow <= fast
        if not (rising and min(self.frequency[0], slow, period) > 0.0):
            raise ParameterError(f"{self}: give ranges above 0, the lower end first")
        if not fall <= _FASTEST * period:
            raise ParameterError(
                f"a slip of {high - low:g} V takes {1e6 * fall:g} us of a period of "
                f"{1e6 * period:g} us, {100 * _FASTEST:g} % is the limit: raise the slewrate, "
                "or lower the frequency"
            )
        gain = p.actuator.gain_in_force
        return ActionScale(self.sample or 0.0, low, high, gain, self.frequency, (slow, fast))


def action_of(
    drive: ActionScale, amplitude: float, level: float, frequency: float, slewrate: float
) -> Array:
    """Return the action, (4,), of a drive cycle; its numbers lie within -1 and 1.

    The cycle moves the actuator slowly to level + amplitude and slips to level (V), with the
    slewrate (V/us). The sign of the amplitude (V) is the direction of the step; with 0 the level is
    approached without a slip. frequency in Hz. ParameterError if that is beyond the ranges.
    """
    span, fall = drive.high - drive.low, abs(amplitude)
    room, lower = span - fall, min(level, level + amplitude)
    action = np.zeros(4)
    action[AMPLITUDE] = amplitude / span
    action[PLACE] = 2.0 * (lower - drive.low) / room - 1.0 if room > 0.0 else 0.0
    for place, value, (low, high) in (
        (FREQUENCY, frequency, drive.frequency),
        (SLEWRATE, _PER_MICROSECOND * slewrate, drive.slewrate),
    ):
        action[place] = (
            2.0 * math.log(value / low) / math.log(high / low) - 1.0 if high > low else 0
        )
    if not np.abs(action).max() <= 1.0 + 1e-9:
        raise ParameterError(
            f"amplitude {amplitude:g} V, level {level:g} V, frequency {frequency:g} Hz or slewrate "
            f"{slewrate:g} V/us lies beyond {drive}: stay within"
        )
    return np.clip(action, -1.0, 1.0)


class AxisBatch:
    """Axes of one set of parameters, some of which each may have for itself."""

    def __init__(self, p: Parameters, count: int, ranges: DriveRanges) -> None:
        """Set up count axes. ParameterError for effects that they are without."""
        _check_effects(p)
        self.parameters, self.drive = p, ranges.drive(p)
        sensor = Sensor(p.sensor)
        self.sensing = Sensing(
            sensor.rate, sensor.delay, p.sensor.sensor_resolution or 0.0,
            np.zeros(count), np.zeros(count), np.zeros(count, np.int64),
        )  # fmt: skip
        contacts = len(Plant.of(p).contacts)
        self.chain = Chain.of(p) if has_chain(p.actuator) else None
        places = 0 if self.chain is None else len(self.chain.rest())
        self.buffers = Buffers(
            np.zeros((count, PLANT_SIZE)),
            np.zeros((count, KERNEL_SIZE)),
            np.zeros((count, 2 * contacts * CONTACT_SIZE)) if contacts else None,
            np.zeros((count, sensor.delay + 1)),
            np.zeros((count, places)),
            np.zeros((count, 3)),
        )
        self._rest = np.zeros(KERNEL_SIZE)
        at_rest(self._rest, None)
        _records(self._rest, STATE)["replay"] = 0
        numbers: list[Any] = [np.zeros(count) for _ in States._fields[:-1]]
        self.states = States._make([*numbers, np.zeros(count, np.int64)])

    def __len__(self) -> int:
        """Return the number of axes."""
        return len(self.states.t)

    def check_varied(self, name: str, values: Sequence[float]) -> None:
        """Refuse values of a parameter that all axes share. ParameterError."""
        row = parameter(name)
        if row.kind is not float or not (row.group in _OWN_GROUPS or name in _OWN_OF_SENSOR):
            raise ParameterError(
                f"{name} is the same for all axes of an environment: draw numbers of friction and "
                f"runner, {' and '.join(_OWN_OF_SENSOR)}"
            )
        for value in values:
            _check_effects(self.parameters.replace(**{name: value}))

    def start(self, which: NDArray[np.int64], columns: Columns, seeds: NDArray[np.int64]) -> None:
        """Let some axes start from rest, with values of parameters by name and seeds of noise.

        which: indices (some,); values and seeds have the same shape. ParameterError.
        """
        self.buffers.axes[which] = self._rest
        if self.buffers.contacts is not None:
            self.buffers.contacts[which] = 0.0
        for column in self.states:
            column[which] = 0
        self.buffers.sampled[which] = self.buffers.actuators[which] = 0.0
        self.change(which, columns)
        varied = self.parameters.replace(**columns).sensor
        self.sensing.noise[which], self.sensing.drift[which] = (
            varied.sensor_noise, varied.sensor_drift,
        )  # fmt: skip
        self.sensing.seed[which] = seeds
        for k in which.tolist():
            self.states.reading[k] = read(self.buffers.sampled[k], self.sensing, k, 0)

    def change(self, which: NDArray[np.int64], columns: Columns) -> None:
        """Change the plants of some axes, between two periods; see `start`."""
        p = self.parameters.replace(**columns)
        plants = Plant.column(p)
        possible = np.broadcast_to(is_defined(plants.contact), len(which))
        if not possible.all():
            bad = {name: float(column[~possible][0]) for name, column in columns.items()}
            raise ParameterError(f"{bad} makes no contact: narrow the ranges that are drawn from")
        self.buffers.plants[which] = 0.0
        records = _records(self.buffers.plants, PLANT)
        numbers = dict(zip(Contact._fields, plants.contact, strict=True))
        numbers |= {"mass": plants.mass, "force": plants.force, "spring": plants.spring}
        for name, column in {**numbers, "tolerance": p.solver.tolerance}.items():
            records[name][which] = column
        for k in which.tolist():
            derive_constants(self.buffers.plants[k])
        if self.buffers.contacts is not None:
            each = _records(self.buffers.contacts, CONTACT_RECORD, len(plants.contacts))
            own = dict(zip(OWN_CONSTANTS, plants.own, strict=True))
            for i, contact in enumerate(plants.contacts):
                for name, column in {**contact._asdict(), **own}.items():
                    each[name][which, i] = column
        if self.chain is not None:
            for k, plant in zip(which.tolist(), plants.points(len(which)), strict=True):
                self.buffers.limits[k] = limits_of_pieces(p.actuator, plant)
        # From where no arc reaches a stop, see `plants.set_clear_range`
        state = _records(self.buffers.axes, STATE)
        deflections = [np.abs(state["now_z"][which])]
        for contact in (plants.contact, *plants.contacts):
            deflections += [contact.z_ba, contact.z_ss, contact.z_k, contact.z_s]
        stroke = self.drive.gain * (self.drive.high - self.drive.low)
        stroke *= 1.0 if self.chain is None else _OVERSHOOT
        reach = stroke + 2.0 * np.maximum.reduce(np.broadcast_arrays(*deflections))
        low, high = p.limits.travel_low, p.limits.travel_high
        state["low"][which], state["high"][which] = low, high
        state["near_low"][which], state["near_high"][which] = low + reach, high - reach

    def run(self, actions: Array) -> None:
        """Run a period with actions, (axes, numbers), -1 to 1. SolverError."""
        count = len(self)
        threads = min(os.cpu_count() or 1, max(count // _WORTH_A_THREAD, 1))
        parts = list(pairwise(count * k // threads for k in range(threads + 1)))
        actions = np.clip(actions, -1.0, 1.0)
        arguments = self.buffers, self.states, actions, self.drive, self.chain, self.sensing
        if len(parts) == 1:
            with report_compilation():
                run_periods(*arguments, parts[0])
        else:
            list(_threads().map(lambda part: run_periods(*arguments, part), parts))
        if self.states.failed.any():
            k = int(np.flatnonzero(self.states.failed)[0])
            raise SolverError(
                f"the solver failed on axis {k}, or a cycle took too long: its contact may not "
                "hold the load; narrow the ranges that are drawn from"
            )


def _records(buffers: Array, record: np.dtype[Any], count: int = 0) -> NDArray[Any]:
    """Return the record that each buffer begins with, (axes,), or the first few, (axes, count)."""
    found = buffers[..., : max(count, 1) * record.itemsize // 8].view(plain_dtype(record))
    return found if count else found[..., 0]


def _check_effects(p: Parameters) -> None:
    """Refuse effects that `periods.run_periods` is without; ParameterError."""
    effects = {
        "hysteresis of the actuator without actuator_memory": not (
            Actuator.of(p.actuator).is_linear or has_chain(p.actuator)
        ),
        "contacts that vary along the surface or with time": Surface.of(p.friction) is not None,
        "a sensor with a bandwidth": has_bandwidth(p.sensor),
        "a sensor with 1/f noise": p.sensor.sensor_noise_corner is not None,
    }
    found = [name for name, has in effects.items() if has]
    if found:
        raise ParameterError(f"environments are without {', '.join(found)}: unset it, or use Axis")


@cache
def _threads() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(os.cpu_count())
