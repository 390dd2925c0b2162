# SPDX-License-Identifier: Apache-2.0
"""When the readings in joint states were taken, against the positions of the axis itself."""

from stickslip_ros.axis import Axis
from stickslip_ros.axis.joints import JointReport
from stickslip_ros.measurement.twin.own_sensor import OwnSensor

START = 1_795_901_387_308_700_660  # ns


def test_a_reading_counts_from_when_it_was_taken() -> None:
    """Through a change of the sensor while the axis steps, published at odd times."""
    quiet = {
        "sensor_noise": 0.0,
        "sensor_resolution": 0.0,
        "frequency": 100.0,
        "sensor_rate": 800.0,
    }
    axis, report, sensor = Axis(quiet), JointReport(), OwnSensor()
    assert sensor.taken_ns("axis_slider", START + 5) == START + 5  # nothing is known yet
    axis.command("steps", 40)
    truth = Axis(quiet)
    truth.command("steps", 40)
    seen = []
    for k in range(1, 300):
        t = 1e-9 * (k * 1_000_000 + 1_700 * (k % 7))
        axis.advance(t)
        if k == 150:
            axis.command("parameters", {"sensor_latency": 0.004})
        for event in axis.take_events():
            sensor.hear(event, START + round(1e9 * event.time))
        ((_, x, _, _), _) = report.take(axis)
        taken = sensor.taken_ns("axis_slider", START + round(1e9 * t))
        assert sensor.taken_ns("another_slider", START + 7) == START + 7
        if taken is not None and not 150 <= k < 160:  # those that waited when it changed
            seen.append((taken, x))
    assert 220 < len(seen) < 240  # of five messages at 1 kHz one repeats a reading of 800 Hz
    for taken, x in seen:
        truth.advance(1e-9 * (taken - START))
        assert abs(truth.state.x - x) < 1e-13


def test_joint_states_of_the_truth_are_as_old_as_their_stamp() -> None:
    """Those of 1.x, and with joint_state_source truth."""
    for changes in ({"joint_state_source": "truth"}, {}):
        axis, sensor = Axis(changes), OwnSensor()
        (start,) = axis.take_events()
        if not changes:
            del start.details["joint_state_source"]
        sensor.hear(start, START)
        assert sensor.taken_ns("axis_slider", START + 12_345) == START + 12_345
