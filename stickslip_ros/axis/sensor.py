# SPDX-License-Identifier: Apache-2.0
"""The simulated position sensor: noise, drift, resolution, rate and latency.

Reading number k is taken at k / rate seconds of simulation. Its noise depends only on the seed
and k, so looking at a reading, or not, changes nothing. What the runner does between readings
counts with a bandwidth only, see `sensor_dynamics.py`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.parameters import SensorParameters

_BLOCK = 1024  # readings whose noise is drawn together
#: Parts of the 1/f noise, each an octave below the last: at 1 kHz down to periods of 4.7 h
_OCTAVES = 24


class Sensor:
    """A sensor of one set of parameters."""

    def __init__(self, p: SensorParameters) -> None:
        """Take rate, latency, noise, drift, seed and resolution from the parameters."""
        self.rate = p.sensor_rate
        #: age of a reading when it arrives, in readings
        self.delay = math.ceil(p.sensor_latency * self.rate - 1e-9)
        self._resolution = p.sensor_resolution
        self._noise = p.sensor_noise
        self._flicker = _flicker_weight(p)
        self._drift = p.sensor_drift
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
                self._block, self._drawn = block, self._noise_of(block)
            x += float(self._drawn[place])
        if self._drift:
            x += self._drift * self.time_of(k)
        if self._resolution:
            x = round(x / self._resolution) * self._resolution
        return x

    def _noise_of(self, block: int) -> NDArray[np.float64]:
        """Return the noise (m) of the readings of a block, (_BLOCK,)."""
        noise = self._noise * _normals([self._seed, block % 2**32])
        if self._flicker:
            noise = noise + self._flicker * _flicker_of(self._seed, block)
        return noise


def _normals(seed: list[int]) -> NDArray[np.float64]:
    """Return a block of normal numbers that depends only on the seed."""
    # The legacy generator: its numbers are the same in every version of numpy.
    return np.asarray(np.random.RandomState(seed).standard_normal(_BLOCK))


def _flicker_weight(p: SensorParameters) -> float:
    """Return what `_flicker_of` has to be multiplied by, m.

    The one-sided density of the white noise is sigma^2 / (rate / 2), that of 1/f noise the same at
    the corner. Part j of `_flicker_of` has the density 2 T sinc(f T)^4 with T = 2^j / rate. Their
    sum is 2 / (3 ln 2 f): the integral of x sinc(x)^4 over ln x is 1/3.
    """
    if p.sensor_noise_corner is None:
        return 0.0
    density = p.sensor_noise**2 / (0.5 * p.sensor_rate) * p.sensor_noise_corner
    return math.sqrt(1.5 * math.log(2.0) * density)


def _flicker_of(seed: int, block: int) -> NDArray[np.float64]:
    """Return 1/f noise of the readings of a block, (_BLOCK,): a sum of octaves.

    Each part runs straight between normal numbers that stand 2^j readings apart (after R. F. Voss,
    J. Clarke, J. Acoust. Soc. Am. 63 (1978) 258, whose parts are steps). So any block can be had
    without those before it.
    """
    k = np.arange(block * _BLOCK, (block + 1) * _BLOCK)
    noise = _normals([seed, 1 + _OCTAVES, block % 2**32])  # all octaves above the readings' own
    for octave in range(_OCTAVES):
        first, last = int(k[0]) >> octave, (int(k[-1]) >> octave) + 1
        nodes = np.concatenate(
            [
                _normals([seed, 1 + octave, part % 2**32])
                for part in range(first // _BLOCK, last // _BLOCK + 1)
            ]
        )
        start = (first // _BLOCK) * _BLOCK
        noise += np.interp(k / 2.0**octave, np.arange(start, start + len(nodes)), nodes)
    return noise
