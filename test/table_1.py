# SPDX-License-Identifier: Apache-2.0
"""The operating point of Table 1 with sensor and loop, spelt out: its tests follow no default."""

from typing import Any

from stickslip_ros.physics.parameters import Parameters

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


#: Steps (nm) of it by an independent Runge-Kutta integrator, 1e-7 s in the stick and 1e-9 s in the
#: slip, mean of 8 to 12 from rest: over preload (N) at a stroke of 160 nm, and over stroke (nm) at
#: 0.4 N and 1 N.
OVER_PRELOAD = {0.1: 144.70, 0.25: 139.14, 0.4: 133.83, 1: 113.20, 2: 78.91, 3: 45.95, 4: 19.29,
                5: 4.92, 6: 0.63}  # fmt: skip
OVER_STROKE = {20: (0.04, 0.0), 30: (4.73, 0.0), 40: (14.20, 0.96), 60: (34.14, 14.48),
               80: (54.10, 33.85), 100: (74.04, 53.70), 120: (93.98, 73.56), 140: (113.91, 93.39),
               160: (133.83, 113.20)}  # fmt: skip


def table_1(**changes: Any) -> Parameters:
    """Return the operating point of Table 1 with some values replaced."""
    return Parameters.of({**TABLE_1, **changes})
