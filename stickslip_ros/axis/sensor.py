# SPDX-License-Identifier: Apache-2.0
"""The simulated position sensor: noise, resolution, rate and latency.

Reading number k is taken at k / rate seconds of simulation. Its noise hangs on the seed and on k
alone, so looking at a reading, or not, changes nothing.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.parameters import SensorParameters

_BLOCK = 1024  # readings whose noise is drawn together


class Sensor:
    """A sensor of one set of parameters."""

    def __init__(self, p: SensorParameters) -> None:
        """Take rate, latency, noise, seed and resolution from the parameters."""
        self.rate = p.sensor_rate
        #: age of a reading when it arrives, in readings
        self.delay = math.ceil(p.sensor_latency * self.rate - 1e-9)
        self._resolution = p.sensor_resolution
        self._noise = p.sensor_noise
        self._seed = p.sensor_seed
        self._block = -1
        self._drawn: NDArray[np.float64] = np.empty(0)

    def time_of(self, k: int) -> float:
        """Return when reading k is taken, s."""
        return k / self.rate

    def number_at(self, t: float) -> int:
        """Return the number of the last reading at time t (s)."""
        return math.floor(t * self.rate)

    def reading(self, x: float, k: int) -> float:
        """Return what reading number k gives if the runner is at x (m)."""
        if self._noise:
            block, place = divmod(k, _BLOCK)
            if block != self._block:
                self._block = block
                # The legacy generator: its numbers are the same in every version of numpy.
                generator = np.random.RandomState([self._seed, block % 2**32])
                self._drawn = generator.standard_normal(_BLOCK)
            x += self._noise * float(self._drawn[place])
        if self._resolution:
            x = round(x / self._resolution) * self._resolution
        return x
