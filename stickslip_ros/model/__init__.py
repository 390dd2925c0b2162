# SPDX-License-Identifier: Apache-2.0
"""The physics: friction laws, runner and loads, actuator and excitation. SI units throughout."""

from stickslip_ros.model.excitation import WAVEFORMS, Pattern, Patterns, drive_of, ramp, sawtooth
from stickslip_ros.model.friction import LAWS, Contact, alpha_of, friction_force, z_rate
from stickslip_ros.model.plant import GRAVITY, Plant, plant_of

__all__ = [
    "GRAVITY",
    "LAWS",
    "WAVEFORMS",
    "Contact",
    "Pattern",
    "Patterns",
    "Plant",
    "alpha_of",
    "drive_of",
    "friction_force",
    "plant_of",
    "ramp",
    "sawtooth",
    "z_rate",
]
