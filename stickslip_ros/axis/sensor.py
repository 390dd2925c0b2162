# SPDX-License-Identifier: Apache-2.0
"""The simulated position sensor: noise, drift, resolution, rate, latency and bandwidth.

Reading number k is taken at k / rate seconds of simulation. Its noise depends only on the seed
and k, so a reading does not depend on which others are taken.

Motion between readings counts only with a bandwidth, a low-pass before the readings, see
`model.low_pass`. The position is then sampled on a grid that is fine compared with the ringing.
Between samples it is taken for the cubic with the same positions and velocities, for which the
filter is exact. The grid follows the readings, not the calls, so the filter does not depend on how
often the state is read. Once the runner stands still and the filter has settled, only the positions
at readings that are asked for are computed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.base.arrays import Array
from stickslip_ros.physics.model.low_pass import LowPass
from stickslip_ros.physics.parameters import ParameterError, SensorParameters

#: Readings whose noise is drawn together: one call of the generator costs as much as hundreds
_BLOCK = 1024
#: Seeds of the generator are below this
_SEEDS = 2**32
#: Parts of the 1/f noise, each an octave below the last: at 1 kHz down to periods of 4.7 h
_OCTAVES = 24
#: Least samples in a second and in a period of the ringing
_GRID, _PER_PERIOD = 250e3, 40.0
#: Samples in a second at most, which cost a minute of processor: for a ringing of 2.5 MHz
_MOST_SAMPLES = 1e8
#: s between looks whether the runner is still; also of samples at a time, for these take memory
_LOOK = 0.016
#: m that a runner which stands still, and the output, move at most between looks: a hundredth of
#: usual noise. Then each reading is the position at its time.
_STILL = 3e-11
#: Fraction of a reading by which a latency may be beyond whole readings: rounding
_ROUNDING = 1e-9
#: Bandwidths (Hz) below this count as none
LOWEST = 1.0
#: Numbers of readings are below this
_NUMBERS = 2**62


class Sensor:
    """A sensor of one set of parameters."""

    def __init__(self, p: SensorParameters) -> None:
        """Take rate, latency, noise, drift, seed and resolution from the parameters."""
        self.rate = p.sensor_rate
        #: age of a reading when it arrives, in readings
        self.delay = math.ceil(p.sensor_latency * self.rate - _ROUNDING)
        self._resolution = p.sensor_resolution
        self._noise = p.sensor_noise
        #: standard deviation (m) of a reading, without 1/f noise and drift
        self.noise = math.hypot(p.sensor_noise, (p.sensor_resolution or 0.0) / math.sqrt(12.0))
        self._flicker = _flicker_weight(p)
        self._drift = p.sensor_drift
        self._seed = p.sensor_seed
        self._block = -1
        self._drawn: Array = np.empty(0)  # noise (m) of the readings of that block

    def time_of(self, k: int) -> float:
        """Return when reading k is taken, s."""
        return k / self.rate

    def number_at(self, t: float) -> int:
        """Return the number of the last reading at time t (s)."""
        return math.floor(t * self.rate)

    def taken_by(self, t: float) -> int:
        """Return the number of the last reading that is taken by time t (s), without rounding."""
        k = math.floor(t * self.rate)
        if k / self.rate > t:
            return k - 1
        return k + 1 if (k + 1) / self.rate <= t else k

    def reading(self, x: float, k: int) -> float:
        """Return reading number k (m) for a runner at x (m)."""
        if self._noise:
            block, place = divmod(k, _BLOCK)
            if block != self._block:
                self._block = block
                self._drawn = self._noise * _normals([self._seed, block % _SEEDS])
                if self._flicker:
                    self._drawn = self._drawn + self._flicker * _flicker_of(self._seed, block)
            x += float(self._drawn[place])
        if self._drift:
            x += self._drift * self.time_of(k)
        if self._resolution and math.isfinite(x):  # what a failed solver leaves may be no number
            x = round(x / self._resolution) * self._resolution
        return x


def _normals(seed: list[int]) -> Array:
    """Return a block of normal numbers that depends only on the seed."""
    # The legacy generator: its numbers are the same in every version of numpy.
    return np.asarray(np.random.RandomState(seed).standard_normal(_BLOCK))


def _flicker_weight(p: SensorParameters) -> float:
    """Return the factor (m) of `_flicker_of`.

    The one-sided density of the white noise is sigma^2 / (rate / 2), that of 1/f noise the same at
    the corner. Part j of `_flicker_of` has the density 2 T sinc(f T)^4 with T = 2^j / rate. Their
    sum is 2 / (3 ln 2 f): the integral of x sinc(x)^4 over ln x is 1/3.
    """
    if p.sensor_noise_corner is None:
        return 0.0
    density = p.sensor_noise**2 / (0.5 * p.sensor_rate) * p.sensor_noise_corner
    return math.sqrt(1.5 * math.log(2.0) * density)


def _flicker_of(seed: int, block: int) -> Array:
    """Return 1/f noise of the readings of a block, (_BLOCK,): a sum of octaves.

    Each part runs straight between normal numbers that stand 2^j readings apart (after R. F. Voss,
    J. Clarke, J. Acoust. Soc. Am. 63 (1978) 258, whose parts are steps). So any block can be had
    without those before it.
    """
    k = np.arange(block * _BLOCK, (block + 1) * _BLOCK)
    noise = _normals([seed, 1 + _OCTAVES, block % _SEEDS])  # all octaves above the readings' own
    for octave in range(_OCTAVES):
        first, last = int(k[0]) >> octave, (int(k[-1]) >> octave) + 1
        nodes = np.concatenate(
            [
                _normals([seed, 1 + octave, part % _SEEDS])
                for part in range(first // _BLOCK, last // _BLOCK + 1)
            ]
        )
        start = (first // _BLOCK) * _BLOCK
        noise += np.interp(k / 2.0**octave, np.arange(start, start + len(nodes)), nodes)
    return noise


def has_bandwidth(p: SensorParameters) -> bool:
    """Return whether a sensor has a low-pass."""
    return p.sensor_bandwidth is not None and p.sensor_bandwidth >= LOWEST


def samples_per_reading(p: SensorParameters, ringing: float) -> int:
    """Return the number of samples per reading; ringing is the frequency of the runner, Hz.

    Raises ParameterError for a ringing too fast to be followed.
    """
    if not _PER_PERIOD * ringing <= _MOST_SAMPLES:
        raise ParameterError(
            f"sensor_bandwidth is set, and the runner rings at {ringing:.3g} Hz, "
            f"{_MOST_SAMPLES / _PER_PERIOD:g} Hz is the upper limit then: set sensor_bandwidth to "
            "0, lower the stiffness of the contact, or raise mass"
        )
    return math.ceil(max(_GRID, _PER_PERIOD * ringing) / p.sensor_rate)


class Readings:
    """Where the runner was, as the sensor sees it, at the readings that have not arrived yet.

    So what arrives does not depend on how time is divided.
    """

    def __init__(self) -> None:
        """Begin at time 0 with the runner at 0, where it has always been."""
        self._positions = {0: 0.0}  # m, by the number of the reading, rising

    def due(self, sensor: Sensor, t: float, asked: float) -> range:
        """Return the readings up to time t (s) that are to be recorded; forget older ones.

        asked: time (s) before which nobody asks what has arrived.
        """
        last = sensor.taken_by(t)
        arrived = (last if asked <= t else sensor.taken_by(asked)) - sensor.delay
        newest = next(reversed(self._positions))
        while (oldest := next(iter(self._positions))) < min(arrived, newest):
            del self._positions[oldest]
        return range(max(newest + 1, arrived), last + 1)

    def record(self, numbers: range, positions: list[float]) -> None:
        """Note the positions (m) at the readings that were due."""
        self._positions.update(zip(numbers, positions, strict=True))

    def arrived(self, sensor: Sensor, t: float) -> tuple[int, float]:
        """Return number and position (m) of the reading that has arrived last at time t (s).

        After the start, and with a latency that has become longer, that is the oldest there is.
        """
        k = sensor.taken_by(t) - sensor.delay
        if k not in self._positions:
            k = min(self._positions)
        return k, self._positions[k]


class SensorDynamics:
    """The low-pass filtered position of a sensor with a bandwidth, followed in time."""

    def __init__(self, p: SensorParameters, ringing: float, t: float, x: float) -> None:
        """Start settled at time t (s) with the runner at x (m); ringing in Hz."""
        self.parameters = p
        self._samples = samples_per_reading(p, ringing)
        self._rate = p.sensor_rate
        self._group = self._samples * math.ceil(_LOOK * p.sensor_rate)  # samples between looks
        self._next = self._number_at(t) + 1
        self._end = self._next  # sample after those that are due
        self._still = False  # runner and output, in the last group
        self._settled = True  # the filter has to start from `_x`
        self._range = (-math.inf, math.inf)  # of both in this group, m; not of the first
        self._low_pass = LowPass(p, 1.0 / (self._rate * self._samples), x)
        self._x = x  # at the last sample, m
        self.sensed = x  #: filtered position at the last reading, m

    def _times(self, numbers: NDArray[np.int64]) -> Array:
        """Return the times (s) of samples; reading k has exactly that of sample k * `_samples`."""
        return (numbers / self._samples) / self._rate

    def _number_at(self, t: float) -> int:
        """Return the number of the last sample at time t (s)."""
        near = math.floor(t * self._rate * self._samples)
        around = np.arange(near - 1, near + 2)
        return int(around[self._times(around) <= t][-1])

    def wake(self) -> None:
        """Expect motion from now on."""
        self._still = False

    def due(self, t: float, driven: bool = True, first_reading: int = _NUMBERS) -> Iterator[Array]:
        """Yield the times (s) of the samples up to time t (s); pass their samples to `record`.

        driven: whether the actuator is commanded to move until then; first_reading: number of the
        first one that is asked for, the last of them if it is not there yet.
        """
        last = self._number_at(t)
        while self._next <= last:
            self._still = self._still and not driven
            # Whether the runner is still is judged at samples that do not depend on the calls.
            self._end = min((self._next // self._group + 1) * self._group, last + 1)
            first, step = self._next, 1
            if self._still:
                step = self._samples
                asked = min((self._end - 1) // step, first_reading)
                first = max(-(-first // step), asked) * step
            yield self._times(np.arange(first, self._end, step))

    def record(self, x: Array, v: Array) -> Array:
        """Filter positions (m) and velocities (m/s) at the samples that were due, (samples,).

        Returns the output (m) at the readings among them.
        """
        sensed = x
        if not self._still:
            if self._settled:
                self._low_pass.settle(self._x)
            readings = np.arange(self._next, self._end) % self._samples == 0
            y = self._low_pass.filter(x, v)
            low, high = self._range
            self._range = (
                min(low, float(min(x.min(), y.min()))),
                max(high, float(max(x.max(), y.max()))),
            )
            self._x = float(x[-1])
            sensed = y[readings]
            if len(sensed):
                self.sensed = float(sensed[-1])
        elif len(x):
            self._x = self.sensed = float(x[-1])
        self._settled = self._still
        self._next = self._end
        if self._end % self._group == 0:
            low, high = self._range
            self._still = max(high, self._x) - min(low, self._x) <= _STILL
            self._range = (self._x, self._x)
        return sensed
