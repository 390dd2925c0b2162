# SPDX-License-Identifier: Apache-2.0
"""What becomes of a voltage: the deflection of the actuator, linear or with hysteresis.

A new actuator is a function from parameters to an `Actuator` and a line in ACTUATORS. Over the
full loop from 0 to ``max_voltage`` every one of them deflects by ``gain * max_voltage``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from stickslip_ros.model.actuator.hysteresis import hysteresis_text, hysteretic
from stickslip_ros.model.actuator.play import Actuator, Memory, follow, path_of
from stickslip_ros.parameters import ActuatorParameters, ParameterError, Parameters

__all__ = [
    "ACTUATORS",
    "Actuator",
    "Memory",
    "actuator_of",
    "check_voltage",
    "follow",
    "hysteresis_text",
    "path_of",
    "strokes_of",
]


def _linear(p: ActuatorParameters) -> Actuator:
    """Return an actuator that deflects by ``gain`` (m/V) at every voltage."""
    return Actuator(p.gain)


ACTUATORS: Mapping[str, Callable[[ActuatorParameters], Actuator]] = {
    "linear": _linear,
    "hysteresis": hysteretic,
}


def actuator_of(p: ActuatorParameters) -> Actuator:
    """Return the actuator that the parameters name; ParameterError if there is none."""
    try:
        kind = ACTUATORS[p.actuator]
    except KeyError:
        raise ParameterError(f"actuator is {p.actuator!r}; known: {', '.join(ACTUATORS)}") from None
    return kind(p)


def strokes_of(p: Parameters, volts: Any) -> Any:
    """Return the stroke (m) of loops between 0 and volts (V): numbers, or columns (points,)."""
    if p.actuator.actuator == "linear":
        return volts * p.actuator.gain
    if np.ndim(volts) == 0:
        return actuator_of(p.actuator).stroke(volts)
    actuators = (actuator_of(p.point(k).actuator) for k in range(len(volts)))
    return np.array([one.stroke(float(v)) for one, v in zip(actuators, volts, strict=True)])


def check_voltage(p: ActuatorParameters, volts: float) -> None:
    """Refuse a level (V) that the amplifier does not give or the ceramics do not bear.

    Below ``min_voltage`` the ceramics lose their polarisation. Raises ParameterError.
    """
    if not volts <= p.max_voltage:
        raise ParameterError(
            f"{volts:g} V is more than max_voltage, {p.max_voltage:g} V: stay below it"
        )
    if not volts >= p.min_voltage:
        raise ParameterError(
            f"{volts:g} V is below min_voltage, {p.min_voltage:g} V, from where on the actuator "
            "depolarises: stay above it"
        )
