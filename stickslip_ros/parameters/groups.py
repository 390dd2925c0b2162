# SPDX-License-Identifier: Apache-2.0
"""The one table of parameters: every default, unit, range and description stands here alone.

The order of the groups in `Parameters` and of the fields in a group is that of every list of
parameters that users see. An optional parameter (``float | None``) is None while it is not set.
The groups check nothing themselves; `Parameters.of` and `Parameters.replace` do.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from stickslip_ros.parameters.row import number, switch, text


@dataclass(frozen=True)
class FrictionParameters:
    """The friction law and its constants."""

    model: str = text("ceim", "friction law: see stickslip simulate --help")
    preload: float = number(
        0.4, "N", 1e-3, 1e3, "preload f: the normal force that a load cell reads"
    )
    mu: float = number(0.2, "", 1e-3, 10.0, "friction coefficient of the CEIM, Eq. 16")
    preload_ratio: float = number(
        1.0,
        "",
        1e-3,
        1e3,
        "normal force in the law over preload (section 5.2): 1 as in the paper, 2.83 as in Table 5",
    )
    mu_s: float = number(0.3, "", 1e-3, 10.0, "static friction coefficient, Eq. 4")
    mu_k: float = number(0.2, "", 1e-3, 10.0, "kinetic friction coefficient, Eq. 4")
    v_stribeck: float = number(1e-3, "m/s", 1e-6, 1e3, "Stribeck velocity, Eq. 4")
    sigma_0: float | None = number(
        None, "N/m", 0.0, 1e12, "asperity stiffness; 0 takes the law's own value"
    )
    sigma_0_slope: float = number(5e6, "1/m", 0.0, 1e12, "o of Eq. 14, stiffness per preload")
    sigma_0_offset: float = number(7e6, "N/m", 0.0, 1e12, "p of Eq. 14, stiffness without preload")
    sigma_0_cap: float | None = number(
        None, "N", 0.0, 1e3, "preload above which Eq. 14 stays constant; 0: no cap"
    )
    sigma_0ss: float | None = number(
        None, "N/m", 0.0, 1e12, "sigma_0,ss of Eq. 16; 0 takes the law's own value"
    )
    sigma_1: float = number(5.0, "N s/m", 0.0, 1e6, "asperity damping, Eq. 1")
    sigma_2: float = number(0.0, "N s/m", 0.0, 1e6, "viscous friction, Eq. 1")
    z_ba: float | None = number(
        None, "m", 0.0, 1e-3, "breakaway distance; 0 takes the law's own value"
    )
    z_ba_slope: float = number(
        2e-8, "m/N", 0.0, 1e-3, "a of Eq. 13, breakaway distance per preload"
    )
    z_ba_offset: float = number(
        1e-8, "m", 0.0, 1e-3, "b of Eq. 13, breakaway distance without preload"
    )
    z_ss: float | None = number(
        None, "m", 0.0, 1e-3, "steady-state deflection; 0 takes the law's own value"
    )
    alpha_form: str = text(
        "dupont",
        "dupont: alpha uses the sine of |z|; printed: the sine of z, as in the paper",
        pattern="dupont|printed",
    )
    contacts: int = number(
        1,
        "",
        1,
        16,
        "number of contacts that the runner rests on, each with a deflection of its own "
        "(Appendix: 6)",
        False,
    )
    contact_shares: str = text(
        "equal",
        "shares of the contacts in the preload: equal; guide: as in the Appendix, of 6 contacts",
        False,
        "equal|guide",
    )
    contact_spread: float = number(
        0.0,
        "",
        0.0,
        1.0,
        "spread of the breakaway from contact to contact, a share, typically 0.05 to 0.3; 0: none",
        False,
    )
    surface_spread: float = number(
        0.0,
        "",
        0.0,
        1.0,
        "spread of the breakaway along the way, a share, typically 0.02 to 0.2; 0: none",
        False,
    )
    surface_length: float = number(
        1e-6, "m", 1e-9, 1e-2, "correlation length of this spread, typically 1e-7 to 1e-5", False
    )
    slip_spread: float = number(
        0.0,
        "",
        0.0,
        1.0,
        "spread of the breakaway from cycle to cycle, a share, typically 0.01 to 0.1; 0: none",
        False,
    )
    surface_seed: int = number(1, "", 0, 2**31 - 1, "seed of the spreads", False)
    dwell_growth: float = number(
        0.0,
        "",
        0.0,
        0.5,
        "growth of the breakaway in a decade of the time at rest, a share, typically 0.02 to 0.1; "
        "0: none (Dieterich 1972)",
        False,
    )
    dwell_start: float = number(
        1e-3, "s", 1e-9, 1e6, "time at rest from which on the breakaway grows", False
    )
    rate_growth: float = number(
        0.0,
        "",
        -0.05,
        0.5,
        "growth of the breakaway in a decade of the rate of the slip, a share, typically -0.05 to "
        "0.05; 0: none (Ruina 1983)",
        False,
    )
    rate_start: float = number(
        1e-6, "m/s", 1e-12, 1e3, "rate of the slip from which on the breakaway changes", False
    )


@dataclass(frozen=True)
class RunnerParameters:
    """The runner and its loads."""

    mass: float = number(4e-3, "kg", 1e-6, 1e3, "mass of the runner")
    payload: float = number(0.0, "kg", 0.0, 1e3, "mass carried by the runner")
    force: float = number(0.0, "N", -1e3, 1e3, "constant external force on the runner")
    spring: float | None = number(
        None,
        "N/m",
        0.0,
        1e9,
        "spring (force sensor) that the runner compresses, relaxed at 0; below 1e-3: none",
    )
    inclination: float = number(0.0, "rad", -math.pi, math.pi, "angle of +x above the horizontal")


@dataclass(frozen=True)
class ActuatorParameters:
    """The actuator and its amplifier."""

    gain: float = number(160e-9 / 300.0, "m/V", 1e-12, 1e-3, "actuator deflection per volt")
    max_voltage: float = number(300.0, "V", 1e-3, 1e4, "largest voltage of the amplifier")
    min_voltage: float = number(
        0.0, "V", -1e4, 0.0, "lowest level that does not depolarise the actuator"
    )
    actuator: str = text("linear", "linear or hysteresis")
    hysteresis: float = number(
        0.15, "", 0.0, 0.4, "width of the full loop of the actuator, as a share of its stroke"
    )
    hysteresis_file: str | None = text(None, "file of an identified loop, replaces hysteresis")
    actuator_memory: bool = switch(
        False,
        "follow the hysteresis from the virgin state through every change, not the settled loop",
        False,
    )
    creep: float | None = number(
        None,
        "",
        0.0,
        0.1,
        "growth of the deflection in a decade of time, as a share, typically 0.01 to 0.02; 0: none",
        False,
    )
    creep_start: float = number(0.1, "s", 1e-3, 1e3, "time from which creep counts", False)
    amplifier_bandwidth: float | None = number(
        None, "Hz", 0.0, 1e12, "corner of the amplifier, typically 1e3 to 1e6; 0: no lag", False
    )
    amplifier_slew: float | None = number(
        None,
        "V/us",
        0.0,
        1e6,
        "slope that the amplifier's current allows, typically 0.1 to 500; 0: no limit",
        False,
    )
    actuator_resonance: float | None = number(
        None,
        "Hz",
        0.0,
        1e12,
        "resonance of the actuator, typically 1e4 to 1e6 (paper: 8.2e5); 0: rigid",
        False,
    )
    actuator_damping: float = number(
        0.05, "", 1e-3, 0.99, "damping ratio of this resonance, typically 0.01 to 0.5", False
    )


@dataclass(frozen=True)
class DriveParameters:
    """The voltage that drives the actuator."""

    max_frequency: float = number(1e5, "Hz", 1e-3, 1e7, "highest drive frequency")
    slewrate: float = number(100.0, "V/us", 1e-3, 1e6, "slope of the slip")
    amplitude: float = number(300.0, "V", 1e-9, 1e4, "amplitude at the start, peak to peak", False)
    frequency: float = number(100.0, "Hz", 1e-6, 1e7, "drive frequency at the start", False)
    waveform: str = text("sawtooth", "form of the drive cycle: see stickslip simulate --help")
    hold_before: float = number(0.0, "", 0.0, 0.95, "share of the period held before the slip")
    hold_after: float = number(0.0, "", 0.0, 0.95, "share of the period held after the slip")
    split: float = number(
        0.5, "", 0.0, 1.0, "share of the amplitude in the first part of a shaped slip"
    )
    latency: float = number(0.0, "s", 0.0, 1.0, "time between the parts of a shaped slip")
    waveform_table: str | None = text(None, "CSV file of the waveform table, see docs/drive.md")
    min_frequency: float = number(0.0, "Hz", 0.0, 1e7, "lowest drive frequency")
    amplitude_levels: int | None = number(
        None,
        "",
        0,
        2**31 - 1,
        "number of levels from 0 to max_voltage, to which voltages are rounded; 0: no rounding",
    )
    max_steps: int | None = number(
        None, "", 0, 2**31 - 1, "largest number of steps in a command; 0: no limit"
    )
    scan_rate: float = number(
        1e4, "V/s", 1e-3, 1e9, "rate of a scan and of other slow moves of the actuator"
    )


@dataclass(frozen=True)
class SensorParameters:
    """The simulated position sensor."""

    sensor_rate: float = number(1e3, "Hz", 1.0, 1e5, "rate of the position readings", False)
    sensor_resolution: float | None = number(
        1e-9, "m", 0.0, 1e-3, "resolution of the readings; 0: no rounding"
    )
    sensor_noise: float = number(1e-9, "m", 0.0, 1e-3, "standard deviation of a reading")
    sensor_seed: int = number(1, "", 0, 2**31 - 1, "seed of the noise")
    sensor_latency: float = number(
        1e-3, "s", 0.0, 1.0, "age of a reading when it arrives, rounded up to whole readings"
    )
    sensor_bandwidth: float | None = number(
        None,
        "Hz",
        0.0,
        1e6,
        "corner of the sensor's low-pass, typically 1e3 to 1e5; below 1: no low-pass",
    )
    sensor_order: int = number(1, "", 1, 2, "order of the sensor's low-pass")
    sensor_damping: float = number(
        0.7071067811865476,
        "",
        0.05,
        10.0,
        "damping ratio of a low-pass of second order; 0.707: Butterworth",
    )
    sensor_noise_corner: float | None = number(
        None,
        "Hz",
        0.0,
        1e5,
        "frequency below which 1/f noise exceeds the white noise, typically 1 to 100; 0: none",
    )
    sensor_drift: float = number(
        0.0, "m/s", -1e-3, 1e-3, "rate at which the readings drift, typically 1e-12 to 1e-9"
    )


@dataclass(frozen=True)
class ClosedLoopParameters:
    """The closed loop."""

    target_tolerance: float = number(
        2e-9, "m", 1e-12, 1e-3, "distance from the target that counts as reached"
    )
    hold_time: float = number(
        0.05, "s", 0.0, 1e3, "time within the tolerance until the target counts as reached"
    )
    settle_time: float = number(
        5e-3, "s", 0.0, 10.0, "rest after steps before the position is read"
    )
    target_timeout: float | None = number(
        60.0, "s", 0.0, 1e6, "time without coming nearer to the target that causes a fault; 0: off"
    )


@dataclass(frozen=True)
class LimitParameters:
    """Where the runner may be and how fast."""

    travel_low: float = number(
        -0.01, "m", -1.0, 0.0, "position of the stop at the lower end of the travel", False
    )
    travel_high: float = number(
        0.01, "m", 0.0, 1.0, "position of the stop at the upper end of the travel", False
    )
    soft_low: float = number(-1.0, "m", -1.0, 1.0, "measured position below which no cycle starts")
    soft_high: float = number(1.0, "m", -1.0, 1.0, "measured position above which no cycle starts")
    max_velocity: float | None = number(
        None, "m/s", 0.0, 1e3, "mean velocity over 10 ms that causes a fault; 0: off"
    )
    max_following_error: float | None = number(
        None,
        "m",
        0.0,
        1.0,
        "distance from a trajectory or a held target that causes a fault; 0: off",
    )


@dataclass(frozen=True)
class SolverParameters:
    """How well the equations are solved."""

    tolerance: float = number(1e-11, "m", 1e-15, 1e-9, "allowed error in position per cycle")


@dataclass(frozen=True)
class NodeParameters:
    """The ROS node."""

    axis_name: str = text(
        "axis",
        "the joints are <axis_name>_slider and <axis_name>_piezo",
        mutable=False,
        pattern="[A-Za-z][A-Za-z0-9_]*",
    )
    publish_rate: float = number(100.0, "Hz", 0.1, 1e3, "rate of the published state", False)
    real_time_factor: float = number(
        1.0, "", 0.0, 1e4, "simulated time over real time; 0: as fast as possible", False
    )
    real_time_priority: int | None = number(
        None,
        "",
        0,
        99,
        "priority to request from the FIFO scheduler at the start; 0: normal scheduling",
        False,
    )
    publish_clock: bool = switch(False, "publish the simulated time on /clock", False)
    data_directory: str | None = text(
        None, "folder of the files that parameters may name while the node runs; empty: none", False
    )
