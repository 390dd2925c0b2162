# SPDX-License-Identifier: Apache-2.0
"""The operating point of Table 1, spelt out: tests that mean it say so and follow no default."""

from typing import Any

from stickslip_ros.parameters import Parameters

#: Drive, runner and friction of Table 1 with the constants of Eq. 12-16; SI units, slewrate V/us.
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
}


def table_1(**changes: Any) -> Parameters:
    """Return the operating point of Table 1 with some values replaced."""
    return Parameters.of({**TABLE_1, **changes})
