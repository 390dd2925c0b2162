# SPDX-License-Identifier: Apache-2.0
"""The settings of an axis: parameters, amplitude, frequency, zero of the position.

Every value is checked before it is set. ParameterError names the value and the limit.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from stickslip_ros.axis.faults import NONE, PRELOAD_LOSS, Faults, faults_of
from stickslip_ros.axis.sensor import Sensor, has_bandwidth, samples_per_reading
from stickslip_ros.physics.model import DriveCycle, Plant
from stickslip_ros.physics.model.actuator import Actuator, check_voltage
from stickslip_ros.physics.model.actuator_chain import has_chain
from stickslip_ros.physics.model.waveforms import command_of
from stickslip_ros.physics.parameters import ParameterError, Parameters, parameter
from stickslip_ros.physics.parameters.groups import SLIDER


@dataclass
class Config:
    """The settings in force or waiting for the next cycle; see `Config.of`."""

    parameters: Parameters  #: with amplitude (rounded to the grid) and frequency as commanded last
    sensor: Sensor
    actuator: Actuator
    offset: float = 0.0  #: reading that counts as 0, m
    faults: Faults = NONE  #: that act
    _drive_cycles: dict[tuple[int, float, float], DriveCycle] = field(
        default_factory=dict, init=False
    )

    @property
    def amplitude(self) -> float:
        """Commanded amplitude, rounded to the grid, V."""
        return self.parameters.drive.amplitude

    @property
    def frequency(self) -> float:
        """Commanded frequency, Hz."""
        return self.parameters.drive.frequency

    # -- checks of commands

    def changed(self, changes: Mapping[str, Any], jogs: Iterable[float] = ()) -> Parameters:
        """Return the parameters as they would be with changes; jogs are frequencies (Hz) in use."""
        for name in changes:
            if not parameter(name).mutable:
                commanded = name in ("amplitude", "frequency")
                later = f": later send {name}, on ~/command/{name}" if commanded else ""
                raise ParameterError(f"{name} can be set at the start only{later}")
        new = self.parameters.replace(**changes)
        replace(self, parameters=new).check_all(jogs)
        return new

    def check_all(self, jogs: Iterable[float] = ()) -> None:
        """Raise ParameterError where parameters, amplitude and frequency contradict each other."""
        faults_of(self.parameters)
        plant = self.plant()
        if has_bandwidth(self.parameters.sensor):
            samples_per_reading(self.parameters.sensor, plant.ringing_frequency)
        for frequency in (self.frequency, *jogs):
            self.check_drive(self.rounded(self.amplitude), frequency)

    def check_drive(self, amplitude: float, frequency: float) -> None:
        """Raise ParameterError for an amplitude (V) and frequency (Hz) that cannot be driven."""
        lowest = max(self.parameters.drive.min_frequency, parameter("frequency").low)
        self.drive_cycle(1, amplitude, frequency)
        if frequency < lowest:
            raise ParameterError(
                f"frequency is {frequency:g} Hz; it has to lie between {lowest:g} and "
                f"{self.parameters.drive.max_frequency:g} Hz"
            )

    def nearest(self, volts: float) -> float:
        """Return volts on the grid of ``amplitude_levels``."""
        levels = self.parameters.drive.amplitude_levels
        if levels is None or not math.isfinite(volts):
            return volts
        level = self.parameters.actuator.max_voltage / levels
        return round(volts / level) * level

    def rounded(self, volts: float) -> float:
        """Return an amplitude on that grid, V; ParameterError if it is rounded to 0."""
        nearest, levels = self.nearest(volts), self.parameters.drive.amplitude_levels
        if levels and volts and not nearest:
            level = self.parameters.actuator.max_voltage / levels
            raise ParameterError(
                f"amplitude is {volts:g} V, less than half a level, which is {level:g} V"
            )
        return nearest

    def check_level(self, volts: float) -> None:
        """Raise ParameterError for a level (V) not to be held: amplifier, depolarisation."""
        if not math.isfinite(volts):
            raise ParameterError(f"scan level is {volts:g} V; it has to be a finite number")
        try:
            check_voltage(self.parameters.actuator, volts)
        except ParameterError as error:
            raise ParameterError(f"scan level: {error}") from None

    def check_target(self, x: float) -> None:
        """Raise ParameterError for a target (m, as measured) that must not or cannot be reached."""
        limits, (low, high) = self.parameters.limits, self.reach
        if not low <= x <= high:
            soft = (low, high) == (limits.soft_low, limits.soft_high)
            what = "soft limits" if soft else "travel and soft limits"
            raise ParameterError(
                f"target is {x:g} m; {what} allow {low:g} to {high:g} m: choose one in this range"
            )

    def apply(self, p: Parameters) -> None:
        """Apply parameters that `changed` has found fit."""
        self.parameters = p
        self._drive_cycles.clear()
        self.sensor = Sensor(p.sensor)
        self.actuator = Actuator.of(p.actuator)
        self.drive(self.amplitude, self.frequency)

    def drive(self, amplitude: float, frequency: float) -> None:
        """Set an amplitude (V) and a frequency (Hz) that `check_drive` has found fit."""
        self.parameters = self._driven(self.nearest(amplitude), frequency)

    # -- derived from the settings

    def plant(self) -> Plant:
        """Return contact, mass and loads of the parameters."""
        p = self.parameters
        if PRELOAD_LOSS in self.faults:
            left = p.friction.preload * (1.0 - self.faults.value(PRELOAD_LOSS))
            p = replace(p, friction=replace(p.friction, preload=left))
        return Plant.of(p)

    def drive_cycle(self, sign: int, amplitude: float, frequency: float) -> DriveCycle:
        """Return the cycle for steps in the direction of sign."""
        key = sign, amplitude, frequency
        if key not in self._drive_cycles:
            if len(self._drive_cycles) > 8:  # so many are kept for the commands to come
                self._drive_cycles.clear()
            self._drive_cycles[key] = command_of(self._driven(amplitude, frequency), sign)
        return self._drive_cycles[key]

    def _driven(self, amplitude: float, frequency: float) -> Parameters:
        drive = replace(self.parameters.drive, amplitude=amplitude, frequency=frequency)
        return replace(self.parameters, drive=drive)

    @property
    def joint(self) -> str:
        """Name of the joint that the runner is in messages of ROS."""
        return f"{self.parameters.node.axis_name}{SLIDER}"

    @property
    def reach(self) -> tuple[float, float]:
        """Lowest and highest position (m, as measured) that soft limits and travel leave."""
        limits = self.parameters.limits
        low = max(limits.soft_low, limits.travel_low - self.offset)
        return low, min(limits.soft_high, limits.travel_high - self.offset)

    @property
    def gain(self) -> float:
        """Deflection per volt, m/V."""
        return self.parameters.actuator.gain_in_force

    @property
    def commanded(self) -> Actuator:
        """Return the actuator that converts voltages to commanded deflections.

        If the simulation includes amplifier and actuator, this is a linear one.
        """
        return Actuator(self.gain) if has_chain(self.parameters.actuator) else self.actuator

    def stroke(self, volts: float) -> float:
        """Return the stroke (m) of cycles with an amplitude (V)."""
        return self.actuator.stroke(volts)

    def reading(self, x: float, k: int) -> float:
        """Return the measured position (m) by reading number k, with the runner at x (m)."""
        seen = self.faults.seen(self.sensor.reading(x, k), k, self.sensor.time_of(k))
        return seen - self.offset

    @classmethod
    def of(cls, p: Parameters) -> Config:
        """Return the settings at the start; ParameterError if the parameters make no axis."""
        config = Config(p, Sensor(p.sensor), Actuator.of(p.actuator))
        config.check_all()
        config.apply(p)
        return config
