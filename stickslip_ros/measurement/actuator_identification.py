# SPDX-License-Identifier: Apache-2.0
"""From a measured loop of an actuator to the play operators that repeat it.

The deflection is linear in the weights once the thresholds are chosen, and weights of a piezo
actuator are not negative: least squares with that bound has one answer (K. Kuhnen, European
Journal of Control 9 (2003) 407, has the bound too).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy  # its parts load when they are used, which takes half a second
from numpy.typing import NDArray

from stickslip_ros.model.actuator import Actuator, Memory
from stickslip_ros.parameters import ParameterError

#: Least weight of the voltage itself, as part of the mean slope: no actuator stands still.
_STIFFEST = 1e-6


@dataclass(frozen=True)
class IdentifiedActuator:
    """An actuator with its likeness to the loop that it was identified from."""

    actuator: Actuator
    gain: float  #: mean slope of the full loop, m/V
    span: float  #: full scale: range of the measured deflection, m
    error: float  #: largest deviation from the measurement, share of full scale
    rms_error: float  #: root mean square of the deviations, share of full scale
    width: float  #: largest difference of both branches at one voltage, share of full scale


def identify_hysteresis(
    volts: NDArray[np.float64], deflection: NDArray[np.float64], operators: int
) -> IdentifiedActuator:
    """Return the actuator whose closed loop comes nearest to a measured one.

    volts (V) and deflection (m), each (samples,), in the order of time over one whole cycle of the
    voltage or more, minor loops included; the loop is taken to close. Where the deflection begins
    plays no part. Play operators make loops that look the same turned by half a turn; what a
    measured loop has beyond that stays in the error. Raises ParameterError.
    """
    low, high = float(volts.min()), float(volts.max())
    least = 2 * (operators + 2)
    if len(volts) < least:
        raise ParameterError(
            f"the loop has {len(volts)} samples; {operators} play operators take {least} or more"
        )
    if not high > low:
        raise ParameterError(f"the voltage stays at {low:g} V; a loop goes up and down")
    span = float(np.ptp(deflection))
    if not span > 0.0:
        raise ParameterError("the deflection never changes; is it in the second column, in m?")
    if abs(volts[-1] - volts[0]) > 0.05 * (high - low):
        raise ParameterError(
            f"the voltage begins at {volts[0]:g} V and ends at {volts[-1]:g} V; "
            "a loop ends where it began"
        )
    thresholds = 0.5 * (high - low) * (np.arange(operators) + 0.5) / operators
    plays = _plays(volts, thresholds)
    columns = np.column_stack([volts, plays]) / (high - low)
    weights = _least_squares(columns, deflection / span)
    if not weights[0] > _STIFFEST:
        raise ParameterError(
            "the deflection does not rise with the voltage: the first column has to be the "
            "voltage (V), the second the deflection (m), and both have to run in time"
        )
    fitted = columns @ weights
    deviation = deflection / span - fitted
    deviation -= 0.5 * (deviation.max() + deviation.min())
    scale = span / (high - low)
    actuator = Actuator(float(weights[0]) * scale, thresholds, weights[1:] * scale)
    return IdentifiedActuator(
        actuator,
        gain=actuator.stroke(high - low) / (high - low),
        span=span,
        error=float(np.abs(deviation).max()),
        rms_error=float(np.sqrt(np.mean((deviation - deviation.mean()) ** 2))),
        width=_width(actuator, high - low),
    )


def _plays(volts: NDArray[np.float64], thresholds: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return where the plays stand (V) at each sample of the closed loop, (samples, operators)."""
    memory = Memory(float(volts[0]), np.full(len(thresholds), float(volts[0])))
    for volt in volts.tolist():
        memory = memory.moved(volt, thresholds)
    rows = []
    for volt in volts.tolist():
        memory = memory.moved(volt, thresholds)
        rows.append(memory.plays)
    return np.array(rows)


def _least_squares(
    columns: NDArray[np.float64], wanted: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the weights (none negative) that fit best, whatever the offset of what is wanted."""
    columns, wanted = columns - columns.mean(axis=0), wanted - wanted.mean()
    triangle = np.asarray(np.linalg.qr(np.column_stack([columns, wanted]), mode="r"))
    return np.asarray(scipy.optimize.nnls(triangle[:, :-1], triangle[:, -1])[0])


def _width(actuator: Actuator, full: float) -> float:
    """Return the width of the loop between 0 and full (V), share of its stroke."""
    r = actuator.thresholds  # all of them less than half of full
    volts = np.linspace(0.0, full, 201)[:, None]
    up, down = np.maximum(volts - r, r), np.minimum(volts + r, full - r)
    return float(((down - up) @ actuator.weights).max() / actuator.stroke(full))
