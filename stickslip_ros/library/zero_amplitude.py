# SPDX-License-Identifier: Apache-2.0
"""The 0-amplitude: the actuator deflection up to which the axis makes no steps (section 4.1.3).

Fig. 7 has two methods. Direct: lower the amplitude until the step is no longer measurable.
Intersection: a straight line through clear steps, followed down to where it crosses zero. Steps
shrink more slowly near the end than the line does, so the two differ.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.library.operating_points import bisect, steps_of, why_impossible
from stickslip_ros.model.actuator import strokes
from stickslip_ros.model.waveforms import largest_slip
from stickslip_ros.parameters import PARAMETERS, ParameterError, Parameters
from stickslip_ros.traces.steps import MEASURABLE, TRIAL_STEPS

#: Accuracy of the direct method, m.
_RESOLUTION = 1e-11
#: The slip takes at most this part of a period.
_SLIP_SHARE = 0.999
#: Amplitudes of the intersection method, as parts of the largest one, and the steps that count as
#: clear among them, as part of the actuator's deflection.
INTERSECTION_SHARES = (0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
CLEAR_STEP = 0.1
#: Why there may be no 0-amplitude.
NEVER_STEPS = "the axis does not step even at the largest amplitude"
LOAD_MOVES = "the load moves the runner without the drive"


def zero_amplitude(p: Parameters | Mapping[str, Any]) -> float | None:
    """Return the 0-amplitude (m of actuator deflection), by the direct method.

    None if it does not exist; `why_no_zero_amplitude` gives the reason. Raises ParameterError.
    """
    p = Parameters.of(p)
    found = float(zero_amplitudes(p, 1, TRIAL_STEPS)[0])
    if np.isfinite(found):
        return found
    lowest = PARAMETERS["amplitude"].low
    fault = why_impossible(p.replace(amplitude=max(float(largest_amplitude(p)), lowest)))
    if fault:
        raise ParameterError(fault)
    return None


def why_no_zero_amplitude(p: Parameters, steps: int = TRIAL_STEPS) -> str:
    """Return why the parameters of one point, which are possible, have no 0-amplitude."""
    return LOAD_MOVES if _moves_undriven(p, 1, steps)[0] else NEVER_STEPS


def largest_amplitude(p: Parameters) -> NDArray[np.float64]:
    """Return the largest amplitude (V) that amplifier, frequency, slewrate and waveform allow."""
    return np.minimum(p.actuator.max_voltage, _SLIP_SHARE * largest_slip(p.drive))


def zero_amplitudes(p: Parameters, points: int, steps: int) -> NDArray[np.float64]:
    """Return the 0-amplitude (m) of columns, (points,), by the direct method.

    Bisection between zero and `largest_amplitude` for the largest amplitude whose step stays below
    `MEASURABLE`, judged by a run of steps from rest. The amplitude in p plays no part. nan where
    the axis does not step even at the largest amplitude, and where the load alone moves the runner.
    """
    high = np.broadcast_to(largest_amplitude(p), (points,))

    def steps_at(volts: NDArray[np.float64], where: NDArray[np.bool_]) -> NDArray[np.bool_]:
        return _measurable(p.replace(amplitude=volts), points, steps, where)

    where = steps_at(high, ~_moves_undriven(p, points, steps))
    volts = bisect(steps_at, np.zeros(points), high, where, _RESOLUTION / p.actuator.gain_in_force)
    return np.asarray(strokes(p, volts))


def _moves_undriven(p: Parameters, points: int, steps: int) -> NDArray[np.bool_]:
    """Return where the runner moves at a vanishing amplitude already, (points,)."""
    return _measurable(p.replace(amplitude=PARAMETERS["amplitude"].low), points, steps)


def _measurable(
    p: Parameters, points: int, steps: int, where: NDArray[np.bool_] | None = None
) -> NDArray[np.bool_]:
    step_size, _ = steps_of(p, points, steps, where)
    return np.abs(step_size) >= MEASURABLE


def intersections(p: Parameters, points: int, steps: int) -> NDArray[np.float64]:
    """Return the 0-amplitude (m) of columns, (points,), by the intersection method.

    Least squares through the steps at `INTERSECTION_SHARES` of the `largest_amplitude`, those left
    out that are no `CLEAR_STEP`. nan where fewer than three are clear.
    """
    largest = np.broadcast_to(largest_amplitude(p), (points,))
    deflection = np.stack([strokes(p, share * largest) for share in INTERSECTION_SHARES])
    step = np.stack(
        [
            np.copysign(1.0, steps)
            * steps_of(p.replace(amplitude=share * largest), points, steps)[0]
            for share in INTERSECTION_SHARES
        ]
    )
    return crossings(deflection, step, step >= CLEAR_STEP * deflection)


def crossings(
    deflection: NDArray[np.float64], step: NDArray[np.float64], clear: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Return where straight lines through clear steps cross zero, m of actuator deflection.

    All of shape (amplitudes, points), lengths in m; least squares, (points,). nan where fewer than
    three steps are clear.
    """
    count = clear.sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean_deflection = np.where(clear, deflection, 0.0).sum(axis=0) / count
        mean_step = np.where(clear, step, 0.0).sum(axis=0) / count
        from_mean = np.where(clear, deflection - mean_deflection, 0.0)
        slope = (from_mean * np.where(clear, step, 0.0)).sum(axis=0) / (from_mean**2).sum(axis=0)
        crossing = mean_deflection - mean_step / slope
    return np.where(count >= 3, crossing, np.nan)
