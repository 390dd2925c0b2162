# SPDX-License-Identifier: Apache-2.0
"""Contact, runner and loads, actuator and drive cycle. SI units throughout."""

from stickslip_ros.physics.parameters import PARAMETERS

len(PARAMETERS)  # packages bring their laws before the solver is compiled with them

# ruff: noqa: E402
from stickslip_ros.physics.laws import LAWS
from stickslip_ros.physics.laws.law import Contact
from stickslip_ros.physics.model.contacts import GRAVITY
from stickslip_ros.physics.model.friction import alpha_of, alpha_of_law, friction_force, z_rate
from stickslip_ros.physics.model.plant import Plant
from stickslip_ros.physics.model.waveforms import (
    WAVEFORMS,
    DriveCycle,
    DriveCycles,
    drive_of,
    ramp,
    sawtooth,
)

__all__ = [
    "GRAVITY",
    "LAWS",
    "WAVEFORMS",
    "Contact",
    "DriveCycle",
    "DriveCycles",
    "Plant",
    "alpha_of",
    "alpha_of_law",
    "drive_of",
    "friction_force",
    "ramp",
    "sawtooth",
    "z_rate",
]
