# SPDX-License-Identifier: Apache-2.0
"""The rows of the one table that describe sensor, closed loop, limits, solver and node.

The order of the groups in `Parameters` and of the fields in a group is that of every list of
parameters that users see. An optional parameter (``float | None``) is None while it is not set.
Each number has physical limits and the reason for them. The groups check nothing themselves;
`Parameters.of` and `Parameters.replace` do.
"""

from __future__ import annotations

from dataclasses import dataclass

from stickslip_ros.parameters.row import number, switch, text

#: Default name of the node of an axis
AXIS_NODE = "stickslip_axis"
#: Ends of the names of the joints of an axis, behind its `axis_name`
SLIDER, PIEZO, CONTACT = "_slider", "_piezo", "_contact"

# One row of the table in two or three lines each:
# fmt: off


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
    data_directory: str | None = text(
        None, "folder of the files that parameters may name while the node runs; empty: none",
        mutable=False)
