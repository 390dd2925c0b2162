# SPDX-License-Identifier: Apache-2.0
"""The rows of the one table that describe amplifier, actuator and drive.

The order of the groups in `Parameters` and of the fields in a group is that of every list of
parameters that users see. An optional parameter (``float | None``) is None while it is not set.
Each number has physical limits and the reason for them. The groups check nothing themselves;
`Parameters.of` and `Parameters.replace` do.
"""

from __future__ import annotations

from dataclasses import dataclass

from stickslip_ros.parameters.row import Extended, file, growth_per_kelvin, number, switch, text

#: Temperature (K) at which gain and friction are given: 20 degrees centigrade
ROOM_TEMPERATURE = 293.15

# One row of the table in two or three lines each:
# fmt: off


@dataclass(frozen=True)
class ActuatorParameters:
    """The actuator and its amplifier."""

    gain: float = number(
        160e-9 / 300.0, "m/V", 1e-12, 1e-3, "actuator deflection per volt",
        reason="single crystals give 1e-12 m/V a layer, levers 1e-4 m/V")
    max_voltage: float = number(
        300.0, "V", 1e-3, 1e4, "largest voltage of the amplifier",
        reason="amplifiers of piezos give 10 to 2000 V")
    min_voltage: float = number(
        0.0, "V", -1e4, 0.0, "lowest level that does not depolarise the actuator",
        reason="amplifiers of piezos give 10 to 2000 V")
    actuator: str = text("linear", "linear or hysteresis")
    hysteresis: float = number(
        0.15, "", 0.0, 0.4, "width of the full loop of the actuator, as a share of its stroke",
        reason="soft ceramics have 0.2; from 0.5 on a loop of plays runs backwards")
    hysteresis_file: str | None = file("file of an identified loop, replaces hysteresis")
    actuator_memory: bool = switch(
        False,
        "follow the hysteresis from the virgin state through every change, not the settled loop",
        mutable=False)
    creep: float | None = number(
        None, "", 0.0, 0.1,
        "growth of the deflection in a decade of time, as a share, typically 0.01 to 0.02; 0: none",
        mutable=False, least=1e-12,
        reason="soft ceramics have 0.02; below 1e-12 nothing of it is left to see")
    creep_start: float = number(
        0.1, "s", 1e-3, 1e3, "time from which creep counts", mutable=False,
        reason="the ringing is over after a millisecond, and creep is not seen after an hour")
    amplifier_bandwidth: float | None = number(
        None, "Hz", 0.0, 1e12, "corner of the amplifier, typically 1e3 to 1e6; 0: no lag",
        mutable=False, least=1.0,
        reason="below 1 Hz an amplifier takes seconds for one step, above 1e12 Hz it would be "
        "light")
    amplifier_slew: float | None = number(
        None, "V/us", 0.0, 1e6,
        "slope that the amplifier's current allows, typically 0.1 to 500; 0: no limit",
        mutable=False, least=1e-6,
        reason="at 1 V/s a full stroke takes minutes; 1e6 V/us would be a spark")
    actuator_resonance: float | None = number(
        None, "Hz", 0.0, 1e12,
        "resonance of the actuator, typically 1e4 to 1e6 (paper: 8.2e5); 0: rigid", mutable=False,
        least=1.0,
        reason="a stack of a kilometre rings at 1 Hz, atoms of a crystal at 1e13 Hz")
    actuator_damping: float = number(
        0.05, "", 1e-3, 0.99, "damping ratio of this resonance, typically 0.01 to 0.5",
        mutable=False,
        reason="quartz has 1e-3 in its mount; from 1 on nothing resonates")
    temperature: float = number(
        ROOM_TEMPERATURE, "K", 0.0, 700.0, "temperature of actuator and contact",
        reason="the zero of temperature, up to where piezos lose their polarisation")
    gain_temperature: float = growth_per_kelvin(
        "growth of the gain in a kelvin, as a share of that at 293.15 K, typically 3.3e-3; 0: none")

    @property
    def warmth(self) -> float:
        """Temperature above room temperature, K."""
        return self.temperature - ROOM_TEMPERATURE

    @property
    def gain_in_force(self) -> float:
        """Deflection per volt at the temperature, m/V; at room temperature, the gain itself."""
        return self.gain * (1.0 + self.gain_temperature * self.warmth)


@dataclass(frozen=True)
class DriveParameters(Extended):
    """The voltage that drives the actuator."""

    max_frequency: float = number(
        1e5, "Hz", 1e-3, 1e7, "highest drive frequency",
        reason="of the drive; actuators follow up to a few megahertz")
    slewrate: float = number(
        100.0, "V/us", 1e-3, 1e6, "slope of the slip",
        reason="a volt in a millisecond to a spark")
    amplitude: float = number(
        300.0, "V", 1e-9, 1e4, "amplitude at the start, peak to peak", mutable=False,
        reason="noise of an amplifier is larger below, its voltage smaller above")
    frequency: float = number(
        100.0, "Hz", 1e-6, 1e7, "drive frequency at the start", mutable=False,
        reason="a cycle of twelve days, up to what no actuator follows")
    waveform: str = text(
        "sawtooth", "form of the drive cycle: see stickslip simulate --list-parameters"
    )
    hold_before: float = number(
        0.0, "", 0.0, 0.95, "share of the period held before the slip",
        reason="the slip needs the rest of the period")
    hold_after: float = number(
        0.0, "", 0.0, 0.95, "share of the period held after the slip",
        reason="the slip needs the rest of the period")
    split: float = number(
        0.5, "", 0.0, 1.0, "share of the amplitude in the first part of a shaped slip",
        reason="it is a share")
    latency: float = number(
        0.0, "s", 0.0, 1.0, "time between the parts of a shaped slip",
        reason="runners have stopped ringing after a second")
    waveform_table: str | None = file("CSV file of the waveform table, see docs/drive.md")
    min_frequency: float = number(
        0.0, "Hz", 0.0, 1e7, "lowest drive frequency",
        reason="as of the frequency")
    amplitude_levels: int | None = number(
        None, "", 0, 2**31 - 1,
        "number of levels from 0 to max_voltage, to which voltages are rounded; 0: no rounding",
        reason="31 bits")
    max_steps: int | None = number(
        None, "", 0, 2**31 - 1, "largest number of steps in a command; 0: no limit",
        reason="31 bits")
    scan_rate: float = number(
        1e4, "V/s", 1e-3, 1e9, "rate of a scan and of other slow moves of the actuator",
        reason="an hour for a volt, up to a spark")
