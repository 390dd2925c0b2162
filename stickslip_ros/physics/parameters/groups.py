# SPDX-License-Identifier: Apache-2.0
"""The rows of the one table: contact, runner, actuator, drive, sensor, loop, limits, node.

The order of the groups in `Parameters` and of the fields in a group is that of every list of
parameters that users see. An optional parameter (``float | None``) is None while it is not set.
Each number has physical limits and the reason for them. The groups check nothing themselves;
`Parameters.of` and `Parameters.replace` do.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from stickslip_ros.physics.parameters.row import (
    Extended,
    ParameterError,
    file,
    growth_per_kelvin,
    is_column,
    number,
    switch,
    text,
)

#: Temperature (K) at which gain and friction are given: 20 degrees centigrade
ROOM_TEMPERATURE = 293.15
#: Default name of the node of an axis
AXIS_NODE = "stickslip_axis"
#: Ends of the names of the joints of an axis, behind its `axis_name`
SLIDER, PIEZO, CONTACT_SUFFIX = "_slider", "_piezo", "_contact"

# One row of the table in two or three lines each:
# fmt: off


@dataclass(frozen=True)
class FrictionParameters(Extended):
    """The friction law and its constants."""

    model: str = text("ceim", "friction law: see stickslip simulate --list-parameters")
    preload: float = number(
        0.4, "N", 1e-3, 1e3, "preload f: the normal force that a load cell reads",
        reason="a tenth of a gram to the weight of 100 kg")
    mu: float = number(
        0.2, "", 1e-3, 10.0, "friction coefficient of the CEIM, Eq. 16",
        reason="polymers on ice to rubber, with room for a fit")
    preload_ratio: float = number(
        1.0, "", 1e-3, 1e3,
        "normal force in the law over preload (section 5.2): 1 as in the paper, 2.83 as in Table 5",
        reason="a guide multiplies the preload by 1 to 10")
    mu_s: float = number(
        0.3, "", 1e-3, 10.0, "static friction coefficient, Eq. 4",
        reason="polymers on ice to rubber, with room for a fit")
    mu_k: float = number(
        0.2, "", 1e-3, 10.0, "kinetic friction coefficient, Eq. 4",
        reason="polymers on ice to rubber, with room for a fit")
    v_stribeck: float = number(
        1e-3, "m/s", 1e-6, 10.0, "Stribeck velocity, Eq. 4",
        reason="measured ones lie between 1e-5 and 0.1 m/s")
    sigma_0: float | None = number(
        None, "N/m", 0.0, 1e12, "asperity stiffness; 0 takes the law's own value", least=1.0,
        reason="softer than a rubber band, or stiffer than any contact")
    sigma_0_slope: float = number(
        5e6, "1/m", 0.0, 1e12, "o of Eq. 14, stiffness per preload",
        reason="a preload of 1 N adds at most what a block of steel has")
    sigma_0_offset: float = number(
        7e6, "N/m", 0.0, 1e12, "p of Eq. 14, stiffness without preload",
        reason="blocks of steel are softer")
    sigma_0_cap: float | None = number(
        None, "N", 0.0, 1e3, "normal force above which Eq. 14 stays constant; 0: no cap",
        least=1e-3, reason="the limits of preload")
    sigma_0ss: float | None = number(
        None, "N/m", 0.0, 1e12, "sigma_0,ss of Eq. 16; 0 takes the law's own value", least=1.0,
        reason="the paper's is 1e7 N/m; softer ones give way by a metre per newton")
    sigma_1: float = number(
        5.0, "N s/m", 0.0, 1e6, "asperity damping, Eq. 1",
        reason="a runner of a kilogram would take hours to ring once")
    sigma_2: float = number(
        0.0, "N s/m", 0.0, 1e6, "viscous friction, Eq. 1",
        reason="a newton would move the runner by a micrometre a second")
    z_ba: float | None = number(
        None, "m", 0.0, 1e-3, "breakaway distance; 0 takes the law's own value", least=1e-15,
        reason="far below an atom, and far beyond any asperity")
    z_ba_slope: float = number(
        2e-8, "m/N", 0.0, 1e-3, "a of Eq. 13, breakaway distance per preload",
        reason="1 mm per newton is far beyond any asperity")
    z_ba_offset: float = number(
        1e-8, "m", 0.0, 1e-3, "b of Eq. 13, breakaway distance without preload",
        reason="far beyond any asperity")
    z_ss: float | None = number(
        None, "m", 0.0, 1e-3, "steady-state deflection; 0 takes the law's own value", least=1e-15,
        reason="far below an atom, and far beyond any asperity")
    alpha_form: str = text(
        "dupont", "dupont: alpha uses the sine of |z|; printed: the sine of z, as in the paper",
        pattern="dupont|printed")
    contacts: int = number(
        1, "", 1, 16,
        "number of contacts that the runner rests on, each with a deflection of its own "
        "(Appendix: 6)", mutable=False,
        reason="prismatic guides have six, ball guides up to a dozen")
    contact_shares: str = text(
        "equal",
        "shares of the contacts in the preload: equal; guide: as in the Appendix, of 6 contacts",
        mutable=False, pattern="equal|guide")
    contact_spread: float = number(
        0.0, "", 0.0, 1.0,
        "spread of the breakaway from contact to contact, a share, typically 0.05 to 0.3; 0: none",
        mutable=False,
        reason="at 1 a contact in three gives way at a third of its distance, or thrice")
    surface_spread: float = number(
        0.0, "", 0.0, 1.0,
        "spread of the breakaway along the track, a share, typically 0.02 to 0.2; 0: none",
        mutable=False,
        reason="at 1 the friction changes threefold along the track")
    surface_length: float = number(
        1e-6, "m", 1e-9, 1e-2, "correlation length of this spread, typically 1e-7 to 1e-5",
        mutable=False,
        reason="below a nanometre there are no asperities, beyond 1 cm no travel")
    slip_spread: float = number(
        0.0, "", 0.0, 1.0,
        "spread of the breakaway from cycle to cycle, a share, typically 0.01 to 0.1; 0: none",
        mutable=False,
        reason="at 1 the friction changes threefold from cycle to cycle")
    surface_seed: int = number(
        1, "", 0, 2**31 - 1, "seed of the spreads", mutable=False,
        reason="31 bits seed the generator")
    dwell_growth: float = number(
        0.0, "", 0.0, 0.5,
        "growth of the breakaway in a decade of the time at rest, a share, typically 0.02 to "
        "0.1; 0: none (Dieterich 1972)", mutable=False,
        reason="measured ones lie between 0.005 and 0.1")
    dwell_start: float = number(
        1e-3, "s", 1e-9, 1e6, "time at rest from which on the breakaway grows", mutable=False,
        reason="faster than any atom jumps, or longer than any test")
    rate_growth: float = number(
        0.0, "", -0.05, 0.5,
        "growth of the breakaway in a decade of the rate of the slip, a share, typically -0.05 "
        "to 0.05; 0: none (Ruina 1983)", mutable=False,
        reason="measured ones lie between -0.05 and 0.05; below, friction would vanish")
    rate_start: float = number(
        1e-6, "m/s", 1e-12, 1e3, "rate of the slip from which on the breakaway changes",
        mutable=False,
        reason="an atom in a minute, up to a bullet")
    wear_rate: float = number(
        0.0, "1/m", -1e4, 1e4,
        "share by which the breakaway falls in a metre that the contact slides, typically 1e-4 to "
        "0.1, below 0 while it runs in; 0: none (Archard 1953)", mutable=False, least=1e-9,
        reason="worn out after a few hundred steps, or not after the way to the moon")
    friction_temperature: float = growth_per_kelvin(
        "growth of the breakaway in a kelvin, as a share of that at 293.15 K; 0: none")


@dataclass(frozen=True)
class RunnerParameters:
    """The runner and its loads."""

    mass: float = number(
        4e-3, "kg", 1e-6, 1e3, "mass of the runner",
        reason="a grain of dust to a machine tool")
    payload: float = number(
        0.0, "kg", 0.0, 1e3, "mass carried by the runner",
        reason="as of the mass")
    force: float = number(
        0.0, "N", -1e3, 1e3, "constant external force on the runner",
        reason="the weight of 100 kg")
    spring: float | None = number(
        None, "N/m", 0.0, 1e8,
        "spring (force sensor) that the runner compresses, relaxed at 0; below 1e-3: none",
        least=0.0, reason="blocks of steel have 1e8 N/m; below 1e-3 none is felt")
    inclination: float = number(
        0.0, "rad", -math.pi, math.pi, "angle of +x above the horizontal",
        reason="a full turn")


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


@dataclass(frozen=True)
class SensorParameters:
    """The simulated position sensor."""

    sensor_rate: float = number(
        1e3, "Hz", 1.0, 1e5, "rate of the position readings", mutable=False,
        reason="controllers read at most every 10 us")
    sensor_resolution: float | None = number(
        1e-9, "m", 0.0, 1e-3, "resolution of the readings; 0: no rounding", least=1e-18,
        reason="interferometers resolve 1e-12 m, a ruler 1e-3 m")
    sensor_noise: float = number(
        1e-9, "m", 0.0, 1e-3, "standard deviation of a reading",
        reason="a ruler reads to a millimetre")
    sensor_seed: int = number(
        1, "", 0, 2**31 - 1, "seed of the noise",
        reason="31 bits seed the generator")
    sensor_latency: float = number(
        1e-3, "s", 0.0, 1.0, "age of a reading when it arrives, rounded up to whole readings",
        reason="no loop is closed over a second")
    sensor_bandwidth: float | None = number(
        None, "Hz", 0.0, 1e6,
        "corner of the sensor's low-pass, typically 1e3 to 1e5; below 1: no low-pass",
        least=0.0, reason="sensors of positions end below a megahertz")
    sensor_order: int = number(
        1, "", 1, 2, "order of the sensor's low-pass",
        reason="one or two poles")
    sensor_damping: float = number(
        0.7071067811865476, "", 0.05, 10.0,
        "damping ratio of a low-pass of second order; 0.707: Butterworth",
        reason="two poles that ring for 6 cycles, to two far apart")
    sensor_noise_corner: float | None = number(
        None, "Hz", 0.0, 1e5,
        "frequency below which 1/f noise exceeds the white noise, typically 1 to 100; 0: none",
        least=1e-8,
        reason="seven years, to the highest rate of readings")
    sensor_drift: float = number(
        0.0, "m/s", -1e-3, 1e-3, "rate at which the readings drift, typically 1e-12 to 1e-9",
        reason="a warm-up moves a stage by a nanometre a second")


@dataclass(frozen=True)
class ClosedLoopParameters:
    """The closed loop."""

    target_tolerance: float = number(
        2e-9, "m", 1e-12, 1e-3, "distance from the target that counts as reached",
        reason="interferometers resolve 1e-12 m")
    hold_time: float = number(
        0.05, "s", 0.0, 1e3, "time within the tolerance until the target counts as reached",
        reason="longer than any settling")
    settle_time: float = number(
        5e-3, "s", 0.0, 10.0, "rest after steps before the position is read",
        reason="a runner has stopped ringing by then")
    target_timeout: float | None = number(
        60.0, "s", 0.0, 1e6, "time without coming nearer to the target that causes a fault; 0: off",
        least=1e-6,
        reason="twelve days, and no target is reached in a microsecond")


@dataclass(frozen=True)
class LimitParameters:
    """Where the runner may be and how fast."""

    travel_low: float = number(
        -0.01, "m", -1.0, 0.0, "position of the stop at the lower end of the travel", mutable=False,
        reason="no such drive is longer than a metre")
    travel_high: float = number(
        0.01, "m", 0.0, 1.0, "position of the stop at the upper end of the travel", mutable=False,
        reason="no such drive is longer than a metre")
    soft_low: float = number(
        -1.0, "m", -1.0, 1.0, "measured position below which no cycle starts",
        reason="no such drive is longer than a metre")
    soft_high: float = number(
        1.0, "m", -1.0, 1.0, "measured position above which no cycle starts",
        reason="no such drive is longer than a metre")
    max_velocity: float | None = number(
        None, "m/s", 0.0, 1e3, "mean velocity over 10 ms that causes a fault; 0: off", least=1e-12,
        reason="an atom in a minute, up to a bullet")
    max_following_error: float | None = number(
        None, "m", 0.0, 1.0,
        "distance from a trajectory or a held target that causes a fault; 0: off", least=1e-12,
        reason="interferometers resolve 1e-12 m; the travel is below a metre")
    home: str = text(
        "mark", "reference that home goes to: the mark, or the low or the high end of the travel",
        pattern="mark|low|high")
    home_mark: float = number(
        0.0, "m", -1.0, 1.0, "position of the reference mark, from the model's origin",
        reason="no such drive is longer than a metre")

    def __post_init__(self) -> None:
        """Raise ParameterError for limits that leave no place."""
        ends = self.travel_low, self.travel_high, self.soft_low, self.soft_high
        if any(map(is_column, ends)):
            return
        if self.travel_low == self.travel_high:  # 0, which is the end of both ranges
            raise ParameterError(
                "travel_low and travel_high are 0 m; the runner begins at 0: set one on either side"
            )
        if self.soft_low >= self.soft_high:
            raise ParameterError(
                f"soft_low is {self.soft_low:g} m; it has to be less than soft_high, "
                f"{self.soft_high:g} m"
            )


@dataclass(frozen=True)
class FaultParameters:
    """Faults on demand."""

    allow_faults: bool = switch(
        False, "whether faults may be injected with the parameter fault", mutable=False)
    fault: str | None = text(
        None, "faults to inject, such as sensor_freeze or 'axis_stall 50, sensor_drift 10nm/s'; "
        "empty: none")


@dataclass(frozen=True)
class SolverParameters:
    """How well the equations are solved."""

    tolerance: float = number(
        1e-11, "m", 1e-15, 1e-9, "allowed error in position per cycle",
        reason="rounding of a centimetre, up to a tenth of what a sensor sees")


@dataclass(frozen=True)
class NodeParameters:
    """The ROS node."""

    axis_name: str = text(
        "axis", "the joints are <axis_name>_slider and <axis_name>_piezo", mutable=False,
        pattern="[A-Za-z][A-Za-z0-9_]*")
    publish_rate: float = number(
        100.0, "Hz", 0.1, 1e3, "rate of the published state", mutable=False,
        reason="timers of a node keep up to a kilohertz")
    real_time_factor: float = number(
        1.0, "", 0.0, 1e4, "simulated time over real time; 0: as fast as possible", least=1e-6,
        reason="a second of the axis in twelve days, up to what a processor can do")
    start_paused: bool = switch(
        False, "begin with the time standing still, until ~/pause says false", mutable=False)
    step_time: float = number(
        0.0, "s", 0.0, 1e5, "simulated time to go on by, once, each time it is set during a pause",
        least=1e-9,
        reason="a nanosecond is the unit of stamps; a day is long to wait for")
    step_cycles: int = number(
        0, "", 0, 10**6, "the same in drive cycles at the present frequency",
        reason="long to wait for")
    overload_limit: float = number(
        0.0, "s", 0.0, 1e6,
        "time for which the axis may be slower than real_time_factor asks, fault after that; "
        "0: no limit",
        reason="from none to ten days")
    real_time_priority: int | None = number(
        None, "", 0, 99,
        "priority to request from the FIFO scheduler at the start; 0: normal scheduling",
        mutable=False,
        reason="Linux has 99")
    publish_clock: bool = switch(False, "publish the simulated time on /clock", mutable=False)
    joint_state_source: str = text(
        "sensor", "what joint_states says: readings of the sensor, as a driver would, or the truth",
        pattern="sensor|truth")
    data_directory: str | None = text(
        None, "folder of the files that parameters may name while the node runs; empty: none",
        mutable=False)
