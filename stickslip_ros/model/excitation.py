# SPDX-License-Identifier: Apache-2.0
"""What drives the actuator: one cycle of u(t) as straight pieces.

Every pattern is piecewise linear, so that one solver runs them all and restarts at every kink. One
that closes (u ends where it began) can be repeated.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.parameters import ParameterError, Values, parameter

#: V/us to V/s
PER_MICROSECOND = 1e6
#: Share of its strokes by which a pattern that closes may miss its start: rounding
_CLOSED = 1e-9


@dataclass(frozen=True)
class Pattern:
    """One cycle of the actuator deflection.

    ``durations`` (s) and ``rates`` (m/s) have shape (segments,); ``slip`` is the index of the
    segment in which the slip begins, -1 if none does; ``sign`` is the direction of the step, +1 or
    -1.
    """

    durations: NDArray[np.float64]
    rates: NDArray[np.float64]
    slip: int
    sign: int

    @property
    def period(self) -> float:
        """Duration of the cycle, s: the sum over the segments, in their order."""
        return float(np.cumsum(self.durations)[-1])

    @property
    def shift(self) -> float:
        """Where u ends less where it began, m; exactly 0 if the pattern closes."""
        strokes = self.durations * self.rates
        shift = float(np.sum(strokes))
        return shift if abs(shift) > _CLOSED * float(np.sum(np.abs(strokes))) else 0.0


def ramp(distance: float, duration: float) -> Pattern:
    """Return a straight way of the actuator over distance (m) within duration (s), without a slip.

    Raises ParameterError if it does not take time.
    """
    if not 0.0 < duration < np.inf:
        raise ParameterError(f"the duration of a ramp is {duration:g} s; it has to be above 0 s")
    return Pattern(
        durations=np.array([duration]),
        rates=np.array([distance / duration]),
        slip=-1,
        sign=-1 if distance < 0.0 else 1,
    )


def sawtooth(
    amplitude: float, frequency: float, slewrate: float, gain: float, sign: int = 1
) -> Pattern:
    """Return the sawtooth of four parameters (section 2, Fig. 2).

    amplitude V peak to peak, frequency Hz, slewrate of the slip V/us, gain of the actuator m/V;
    sign -1 mirrors it (the paper's "sign of the amplitude"): the runner steps to -x.
    Raises ParameterError if the period leaves no time beside the slip.
    """
    rise, fall, stroke = _rise_fall_stroke(amplitude, frequency, slewrate, gain, sign)
    if not rise > 0.0:
        raise ParameterError(
            f"frequency {frequency:g} Hz leaves {1e6 / frequency:g} us a cycle, but the slip of "
            f"{amplitude:g} V at {slewrate:g} V/us takes {1e6 * fall:g} us: stay below "
            f"{1.0 / fall:g} Hz, or lower the amplitude or raise the slewrate"
        )
    return Pattern(
        durations=np.array([rise, fall]),
        rates=np.array([stroke / rise, -stroke / fall]),
        slip=1,
        sign=sign,
    )


def _rise_fall_stroke(
    amplitude: Any, frequency: Any, slewrate: Any, gain: Any, sign: int
) -> tuple[Any, Any, Any]:
    """Return duration of rise and fall (s) and the stroke (m); numbers may be arrays."""
    fall = amplitude / (slewrate * PER_MICROSECOND)
    return 1.0 / frequency - fall, fall, sign * gain * amplitude


def drives_of(p: Values, points: int, sign: int) -> tuple[Pattern, NDArray[np.bool_]]:
    """Return the patterns of many operating points and which of them are possible, (points,).

    Numbers in p may be arrays of shape (points,). Durations and rates have shape (points,
    segments); each possible row is as `drive_of` makes it.
    """
    amplitude, frequency = np.full(points, p["amplitude"]), np.full(points, p["frequency"])
    rise, fall, stroke = _rise_fall_stroke(amplitude, frequency, p["slewrate"], p["gain"], sign)
    possible = (rise > 0.0) & (amplitude <= p["max_voltage"]) & (frequency <= p["max_frequency"])
    with np.errstate(divide="ignore"):
        rates = np.stack([stroke / rise, -stroke / fall], axis=1)
    return Pattern(np.stack([rise, fall], axis=1), rates, slip=1, sign=sign), possible


def drive_of(p: Values, sign: int = 1) -> Pattern:
    """Return the pattern that the parameters describe; ParameterError if they contradict."""
    for name, limit in (("amplitude", "max_voltage"), ("frequency", "max_frequency")):
        replace(parameter(name), high=p[limit]).check(p[name])
    return sawtooth(p["amplitude"], p["frequency"], p["slewrate"], p["gain"], sign)
