# SPDX-License-Identifier: Apache-2.0
"""Measurements read from files of any kind: `read_measurement` is the way in."""

from stickslip_ros.measurement.reading.choice import Reading
from stickslip_ros.measurement.reading.motion import ActuatorLoop, read_loop, read_measurement
from stickslip_ros.measurement.reading.table import MeasurementError

__all__ = [
    "ActuatorLoop", "MeasurementError", "Reading", "read_loop", "read_measurement",
]  # fmt: skip
