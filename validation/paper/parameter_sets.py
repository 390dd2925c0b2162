# SPDX-License-Identifier: Apache-2.0
"""Parameter sets of the paper, and results of many operating points around them."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from stickslip_ros.base.arrays import Array
from stickslip_ros.physics.model.derivations import sigma_0_of_ringing
from stickslip_ros.physics.parameters import Parameters
from stickslip_ros.simulation.operating_points import generated_forces, steps_of
from stickslip_ros.simulation.settled import TRIAL_STEPS

Set = Mapping[str, Any]
#: The actuator of Table 1: V at its full deflection, m.
FULL_VOLTAGE, FULL_DEFLECTION = 300.0, 160e-9
#: Vibration of Table 1, Hz, and first eigenfrequency of the actuator (Fig. 11), Hz.
VIBRATION, EIGENFREQUENCY = 4e3, 820e3
#: Steps below this, m, are rounding, and have no power.
_NOTHING = 1e-15

#: Table 1, amplitude and gain for the full deflection, with the stiffness of the force fit, Eq. 14.
#: Every other set of the paper changes some of it.
TABLE_1: Set = {
    "model": "ceim", "preload": 0.4, "mass": 4e-3, "mu": 0.2, "sigma_1": 5.0, "sigma_2": 0.0,
    "sigma_0_slope": 5e6, "sigma_0_offset": 7e6, "z_ba_slope": 2e-8, "z_ba_offset": 1e-8,
    "gain": FULL_DEFLECTION / FULL_VOLTAGE, "max_voltage": FULL_VOLTAGE, "amplitude": FULL_VOLTAGE,
    "frequency": 100.0, "slewrate": 100.0, "waveform": "sawtooth",
}  # fmt: skip
#: The same with the stiffness of the vibration, Eq. 11.
STIFFNESS_OF_VIBRATION = sigma_0_of_ringing(VIBRATION, 4e-3)
TABLE_1_VIBRATION: Set = {"sigma_0": STIFFNESS_OF_VIBRATION}
#: One set for step, backstep, vibration, preload and force, as in config/paper_joint_set.yaml: a
#: point of a ridge, along which sigma_0ss, sigma_1 and the spring may change together.
JOINT: Set = {"sigma_0ss": 1.8e7, "sigma_1": 28.0, "mass": 14.3e-3}
#: For its generated force: the sensor, N/m, and what Fig. 15 calls constant stiffness, N/m.
JOINT_SENSOR, JOINT_CONSTANT = 2.0e5, 8.3e6
#: Table 2.
_TABLE_2 = {"sigma_0": 1e6, "mass": 3e-3, "mu_s": 0.3, "mu_k": 0.2, "v_stribeck": 1e-3}
LUGRE: Set = {"model": "lugre", **_TABLE_2}
EPM_FIX: Set = {"model": "epm_fix", "z_ba": 50e-9, "z_ss": 100e-9, **_TABLE_2}
#: With alpha as printed, where z stands for |z|: only so Fig. 5 comes out.
EPM_CALC: Set = {"model": "epm_calc", "z_ba": 100e-9, "alpha_form": "printed", **_TABLE_2}


def columns(base: Set, **varied: Array | float) -> Parameters:
    """Return Table 1 with base and then columns, (points,), laid over it, each value checked."""
    return Parameters.of({**TABLE_1, **base}).replace(**varied)


def steps_and_backsteps(base: Set, **varied: Array | float) -> tuple[Array, Array]:
    """Return step size and backstep (m) over columns of equal length, each (points,)."""
    points = max((len(np.atleast_1d(column)) for column in varied.values()), default=1)
    return steps_of(columns(base, **varied), points, TRIAL_STEPS)


def steps(base: Set, count: int = TRIAL_STEPS, **varied: Array) -> Array:
    """Return the step size (m) over columns of equal length, (points,)."""
    points = len(next(iter(varied.values())))
    return steps_of(columns(base, **varied), points, count)[0]


def one_step(base: Set) -> float:
    """Return the step size (m) of one operating point."""
    return float(steps_and_backsteps(base)[0][0])


def forces(base: Set, preload: Array) -> Array:
    """Return the generated force (N) over preloads (N), (points,)."""
    return generated_forces(columns(base, preload=preload), len(preload), 1)


def power(x: Array, y: Array) -> float:
    """Return the power of x with which y grows."""
    return float(np.polyfit(np.log(x), np.log(np.maximum(y, _NOTHING)), 1)[0])


def mesh(slow: Array, fast: Array) -> tuple[Array, Array]:
    """Return both axes of a grid as columns, the fast one varying first."""
    return np.repeat(slow, len(fast)), np.tile(fast, len(slow))


def volts(deflection: Array) -> Array:
    """Return the amplitude (V) of an actuator deflection (m) with the gain of Table 1."""
    return deflection * (FULL_VOLTAGE / FULL_DEFLECTION)
