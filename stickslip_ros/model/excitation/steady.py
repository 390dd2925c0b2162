# SPDX-License-Identifier: Apache-2.0
"""The pattern that an actuator with a memory makes of a voltage that repeats."""

from __future__ import annotations

import numpy as np

from stickslip_ros.model.actuator import Actuator, follow, path_of
from stickslip_ros.model.excitation.pattern import Pattern


def through(actuator: Actuator, start: float, voltage: Pattern) -> Pattern:
    """Return the closed pattern of the deflection.

    voltage has rates in V/s, its cycle begins at the level start (V).
    One cycle of the voltage wipes out what the actuator remembered before; the deflection of the
    next one is that of all that follow.
    """
    memory = actuator.rest().moved(start, actuator.thresholds)
    memory = follow(actuator, memory, voltage.durations, voltage.rates)[2]
    pieces: list[tuple[float, float]] = []
    begins = []  # at which piece each segment of the voltage begins
    for duration, rate in zip(voltage.durations.tolist(), voltage.rates.tolist(), strict=True):
        begins.append(len(pieces))
        straight, memory = path_of(actuator, memory, duration, rate)
        pieces += straight
    begins.append(len(pieces))
    durations, rates = np.array(pieces).T
    slip = begins[voltage.slip]
    return Pattern(durations, rates, slip, voltage.sign, begins[voltage.slip_end] - slip)
