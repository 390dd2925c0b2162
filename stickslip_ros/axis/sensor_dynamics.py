# SPDX-License-Identifier: Apache-2.0
"""The bandwidth of the position sensor: a low-pass between the runner and the readings.

    first order:   y' = omega (x - y)
    second order:  y'' = omega^2 (x - y) - 2 zeta omega y'

The runner is looked at on a grid that is fine against its ringing, and taken as straight in
between; for this the filter is exact. The grid belongs to the readings, not to the calls, so how
often somebody looks changes nothing.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import scipy  # its parts load when they are used, which takes half a second
from numpy.typing import NDArray

from stickslip_ros.parameters import SensorParameters

#: Looks a second at least, and in a period of the ringing: with a ringing of 30 nm, straight lines
#: between them are 0.06 nm off at most.
_GRID, _PER_PERIOD = 250e3, 40.0
_CHUNK = 2**16  # looks at a time
#: Bandwidths (Hz) below this count as none
LOWEST = 1.0


class LowPass:
    """The low-pass of a sensor on even samples."""

    def __init__(self, p: SensorParameters, dt: float, x: float) -> None:
        """Start settled at x (m); dt is the time (s) between samples."""
        omega = 2.0 * math.pi * (p.sensor_bandwidth or 0.0)
        system: tuple[list[float], list[float]] = ([omega], [1.0, omega])
        if p.sensor_order == 2:
            system = ([omega**2], [1.0, 2.0 * p.sensor_damping * omega, omega**2])
        b, self._a, _ = scipy.signal.cont2discrete(system, dt, method="foh")
        self._b = b[0]
        self._state = np.zeros(len(self._a) - 1)
        self._zero = x  # what is filtered is small: so rounding is

    def see(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the output (m) at the next samples x (m), (samples,)."""
        y, self._state = scipy.signal.lfilter(self._b, self._a, x - self._zero, zi=self._state)
        return np.asarray(y + self._zero)


def has_bandwidth(p: SensorParameters) -> bool:
    """Return whether a sensor has a low-pass at all."""
    return p.sensor_bandwidth is not None and p.sensor_bandwidth >= LOWEST


def looks_per_reading(p: SensorParameters, ringing: float) -> int:
    """Return how many looks a reading takes; ringing is the frequency of the runner, Hz."""
    return math.ceil(max(_GRID, _PER_PERIOD * ringing) / p.sensor_rate)


class SensorDynamics:
    """What a sensor with a bandwidth sees of a motion, followed in time."""

    def __init__(self, p: SensorParameters, ringing: float, t: float, x: float) -> None:
        """Start settled at time t (s) with the runner at x (m); ringing in Hz."""
        self.parameters = p
        self._looks = looks_per_reading(p, ringing)
        self._rate = p.sensor_rate
        self._next = self._number_at(t) + 1
        self._low_pass = LowPass(p, 1.0 / (self._rate * self._looks), x)
        self.seen = x  #: what the last reading sees, m

    def _times(self, numbers: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the times (s) of looks; that of look k * looks is that of reading k exactly."""
        return (numbers / self._looks) / self._rate

    def _number_at(self, t: float) -> int:
        """Return the number of the last look at time t (s)."""
        near = math.floor(t * self._rate * self._looks)
        around = np.arange(near - 1, near + 2)
        return int(around[self._times(around) <= t][-1])

    def due(self, t: float) -> Iterator[NDArray[np.float64]]:
        """Yield the times (s) of the looks up to time t (s), to be answered by `see`."""
        last = self._number_at(t)
        while self._next <= last:
            yield self._times(np.arange(self._next, min(self._next + _CHUNK, last + 1)))

    def see(self, x: NDArray[np.float64]) -> None:
        """Take the positions (m) of the runner at the looks that were due, (looks,)."""
        y = self._low_pass.see(x)
        numbers = np.arange(self._next, self._next + len(x))
        readings = np.flatnonzero(numbers % self._looks == 0)
        if len(readings):
            self.seen = float(y[readings[-1]])
        self._next += len(x)
