# SPDX-License-Identifier: Apache-2.0
"""The operating point of Table 1 with sensor and loop, spelt out: its tests follow no default."""

from typing import Any

from stickslip_ros.parameters import Parameters

#: Drive, runner and friction of Table 1 with the constants of Eq. 12-16, then sensor, closed loop,
#: travel and solver; SI units, slewrate V/us.
TABLE_1: dict[str, Any] = {
    "model": "ceim",
    "preload": 0.4,
    "mu": 0.2,
    "mu_s": 0.3,
    "mu_k": 0.2,
    "v_stribeck": 1e-3,
    "sigma_0_slope": 5e6,
    "sigma_0_offset": 7e6,
    "sigma_1": 5.0,
    "sigma_2": 0.0,
    "z_ba_slope": 2e-8,
    "z_ba_offset": 1e-8,
    "mass": 4e-3,
    "gain": 160e-9 / 300.0,
    "max_voltage": 300.0,
    "max_frequency": 1e5,
    "slewrate": 100.0,
    "amplitude": 300.0,
    "frequency": 100.0,
    "waveform": "sawtooth",
    "scan_rate": 1e4,
    "sensor_rate": 1e3,
    "sensor_resolution": 1e-9,
    "sensor_noise": 1e-9,
    "sensor_seed": 1,
    "sensor_latency": 1e-3,
    "sensor_order": 1,
    "sensor_damping": 0.5**0.5,
    "target_tolerance": 2e-9,
    "hold_time": 0.05,
    "settle_time": 5e-3,
    "target_timeout": 60.0,
    "travel_low": -0.01,
    "travel_high": 0.01,
    "tolerance": 1e-11,
}


def table_1(**changes: Any) -> Parameters:
    """Return the operating point of Table 1 with some values replaced."""
    return Parameters.of({**TABLE_1, **changes})
