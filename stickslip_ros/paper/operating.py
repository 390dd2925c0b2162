# SPDX-License-Identifier: Apache-2.0
"""Operating points of the paper: its parameter sets, and steps over columns of parameters."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.model.derivations import sigma_0_of_ringing
from stickslip_ros.parameters import Parameters
from stickslip_ros.studies.operating_points import steps_of
from stickslip_ros.traces.steps import TRIAL_STEPS

NANO = 1e9
#: The actuator of Table 1: V at its full deflection, m.
FULL_VOLTAGE, FULL_DEFLECTION = 300.0, 160e-9
#: Vibration of Table 1, Hz, and first eigenfrequency of the actuator (Fig. 11), Hz.
VIBRATION, EIGENFREQUENCY = 4e3, 820e3
#: Below this a step counts as none, m: the dead zone of Fig. 3.
NO_STEP = 0.05e-9

#: Table 1 with the stiffness of the force fit, Eq. 14 (all defaults), and of the vibration, Eq. 11.
TYPICAL: Mapping[str, Any] = {}
STIFFNESS_OF_VIBRATION = sigma_0_of_ringing(VIBRATION, 4e-3)
RINGING: Mapping[str, Any] = {"sigma_0": STIFFNESS_OF_VIBRATION}
#: Table 2.
_TABLE_2 = {"sigma_0": 1e6, "mass": 3e-3, "mu_s": 0.3, "mu_k": 0.2, "v_stribeck": 1e-3}
LUGRE: Mapping[str, Any] = {"model": "lugre", **_TABLE_2}
EPM_CALC: Mapping[str, Any] = {"model": "epm_calc", "z_ba": 100e-9, **_TABLE_2}
EPM_FIX: Mapping[str, Any] = {"model": "epm_fix", "z_ba": 50e-9, "z_ss": 100e-9, **_TABLE_2}
#: Eq. 7 to the letter: the fixed distances in alpha alone, g(v) (here mu_k f / sigma_0) below it.
EPM_FIX_LITERAL: Mapping[str, Any] = {
    "model": "ceim", "z_ba": 50e-9, "z_ss": 100e-9, "sigma_0": 1e6, "sigma_0ss": 1e6, "mass": 3e-3,
}  # fmt: skip


def columns(
    base: Parameters | Mapping[str, Any], **varied: NDArray[np.float64] | float
) -> Parameters:
    """Return a checked full set with some of its numbers replaced by columns, (points,)."""
    return Parameters.of(base).replace(**varied)


def steps(
    base: Parameters | Mapping[str, Any], count: int = TRIAL_STEPS, **varied: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the step size (m) over columns of equal length, (points,)."""
    points = len(next(iter(varied.values())))
    return steps_of(columns(base, **varied), points, count)[0]


def mesh(
    slow: NDArray[np.float64], fast: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return both axes of a grid as columns, the fast one varying first."""
    return np.repeat(slow, len(fast)), np.tile(fast, len(slow))


def volts(deflection: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the amplitude (V) of an actuator deflection (m) with the gain of Table 1."""
    return deflection * (FULL_VOLTAGE / FULL_DEFLECTION)
