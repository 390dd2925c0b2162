# SPDX-License-Identifier: Apache-2.0
"""A recording of voltage and deflection, cut at the turning points of the voltage.

Between two turning points the voltage rises or falls, and the state of a play operator follows from
its state at the first one. Changes below `_LEAST_WAY` of the range, or within the noise, do not
count.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy  # its parts load when they are used, which takes half a second
from numpy.typing import NDArray

from stickslip_ros.parameters import ParameterError
from stickslip_ros.traces.even_samples import noise_of, without_spikes

Array = NDArray[np.float64]

#: Least way between two turning points, as a share of the range of the voltage, and in standard
#: deviations of its noise.
_LEAST_WAY, _NOISES = 0.01, 12.0
#: Largest noise, as share of the range, at which turning points can be found.
_NOISY = 0.5
#: A turning point so near to an end of the range, as a share of it, is at that end.
_END = 0.1
#: A voltage that changes by less than this share of the range stays where it is.
_STILL = 0.005
#: Samples that a fit sees at most, means of neighbours; neighbours whose lowest and highest may be
#: turning points.
_MOST, _SOUGHT = 20_000, 20_000
#: What counts as noise in a spike, as share of the range: a spike is eight times as far off.
_RIPPLE = 0.006


@dataclass(frozen=True)
class ActuatorRecording:
    """Means of neighbouring samples, (means,), and the turning points between them, (turns,).

    The first and the last sample count as turning points.
    """

    times: Array  #: s, or numbers of samples where the time is not known
    volts: Array  #: V
    deflection: Array  #: m
    way: NDArray[np.int64]  #: number of the turning point before each mean
    turn_volts: Array  #: voltage at each turning point
    first: int  #: the first mean from which on no earlier past plays a part; 0 if there is none
    loops: int  #: whole loops from there on

    @property
    def range(self) -> float:
        """Highest less lowest voltage (V)."""
        return float(np.ptp(self.turn_volts))

    @cached_property
    def longest_rest(self) -> float:
        """Longest time (s) from `first` on in which the voltage stays where it is."""
        near, longest = _STILL * self.range, 0.0
        times, volts = self.times[self.first :].tolist(), self.volts[self.first :].tolist()
        begin, low, high = times[0], volts[0], volts[0]
        for time, volt in zip(times, volts, strict=True):
            low, high = min(low, volt), max(high, volt)
            if high - low > near:
                begin, low, high = time, volt, volt
            longest = max(longest, time - begin)
        return longest

    def plays(self, thresholds: Array, start: Array) -> tuple[Array, Array]:
        """Return the plays (V) at each mean, (means, operators), and after the last.

        thresholds and start, the plays before the first sample, are in V, (operators,).
        """
        stands = np.empty((len(self.turn_volts), len(thresholds)))
        stand = start
        for k, volts in enumerate(self.turn_volts):
            stands[k] = stand = np.clip(stand, volts - thresholds, volts + thresholds)
        rises = np.diff(self.turn_volts) > 0.0
        before, volts = stands[self.way], self.volts[:, None]
        up = np.maximum(before, volts - thresholds)
        down = np.minimum(before, volts + thresholds)
        return np.where(rises[self.way][:, None], up, down), stands[-1]


def record(times: Array | None, volts: Array, deflection: Array) -> ActuatorRecording:
    """Cut a recording; times (s), volts (V) and deflection (m) have the shape (samples,).

    Raises ParameterError if the voltage has no whole loop, or the deflection does not change.
    """
    if not float(np.ptp(volts)) > 0.0:
        raise ParameterError(f"the voltage stays at {volts[0]:g} V; a loop goes up and down")
    if not float(np.ptp(deflection)) > 0.0:
        raise ParameterError("the deflection never changes; is it in the second column, in m?")
    kept = np.logical_and(
        *(without_spikes(one, _RIPPLE * float(np.ptp(np.quantile(one, [0.001, 0.999]))))
          for one in (volts, deflection))
    )  # fmt: skip
    volts, deflection = volts[kept], deflection[kept]
    times = np.flatnonzero(kept).astype(np.float64) if times is None else times[kept]
    turns = _turning_points(volts)
    first, loops = _settled(volts[turns])
    share = -(-len(volts) // _MOST)
    starts = np.union1d(np.arange(0, len(volts), share), turns[1:-1])
    counts = np.diff(np.append(starts, len(volts)))
    means = [np.add.reduceat(one, starts) / counts for one in (times, volts, deflection)]
    way = np.searchsorted(turns[1:-1], starts, side="right")
    return ActuatorRecording(
        times=means[0],
        volts=means[1],
        deflection=means[2],
        way=way,
        turn_volts=volts[turns],
        first=int(np.searchsorted(starts, turns[first])),
        loops=loops,
    )


def _turning_points(volts: Array) -> NDArray[np.int64]:
    """Return the places of the turning points in volts, both ends included. ParameterError."""
    whole, noise = float(np.ptp(volts)), noise_of(volts)
    least = max(_LEAST_WAY * whole, _NOISES * noise)
    if least > _NOISY * whole:
        raise ParameterError(
            f"the voltage goes over {whole:.3g} V and has {noise:.3g} V of noise: no loop is to be "
            "seen in it; is that the column of the voltage?"
        )
    share = max(1, len(volts) // _SOUGHT)
    rows = volts[: len(volts) // share * share].reshape(-1, share)
    # The lowest and the highest of neighbours are enough.
    lowest, highest = (np.arange(0, rows.size, share) + one
                       for one in (rows.argmin(axis=1), rows.argmax(axis=1)))  # fmt: skip
    found = [0, len(volts) - 1]
    for sign, places in ((1.0, highest), (-1.0, lowest)):
        # An end of the recording is as far from the next turning point as any.
        seen = np.pad(sign * volts[places], 1, constant_values=-np.abs(volts).max() - whole)
        found += places[scipy.signal.find_peaks(seen, prominence=least)[0] - 1].tolist()
    return np.unique(found)


def _settled(turns: Array) -> tuple[int, int]:
    """Return the turning point from which on the plays are known, and the number of loops after it.

    The plays are known once the voltage has been at both of its ends. 0 if no whole loop follows:
    then the initial plays have to be fitted. ParameterError without a loop.
    """
    low, high = float(turns.min()), float(turns.max())
    near = _END * (high - low)
    ends = [(k, volts > low + near) for k, volts in enumerate(turns.tolist())
            if not low + near < volts < high - near]  # fmt: skip
    met = [end for end, before in zip(ends, [None, *ends], strict=False)
           if before is None or end[1] != before[1]]  # fmt: skip
    closes = len(met) == 2 and abs(turns[-1] - turns[0]) < near
    if len(met) < 3 and not closes:
        raise ParameterError(
            f"the voltage begins at {turns[0]:g} V and ends at {turns[-1]:g} V, between "
            f"{low:g} V and {high:g} V, and never goes from end to end and back; "
            "a loop ends where it began"
        )
    later = (len(met) - 2) // 2
    return (met[1][0], later) if later else (0, 1)
