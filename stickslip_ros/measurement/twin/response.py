# SPDX-License-Identifier: Apache-2.0
"""What the kernel says of a drive: the position over its cycles, with derivatives.

A curve is made once for each drive and set of parameters; the tracker and the search for causes
interpolate in it. Nobody knows the phase of the ringing after tens of its periods, so curves are
means over about one period of it, and say how far the runner is from them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d

from stickslip_ros.base.arrays import Array
from stickslip_ros.measurement.twin.timeline import RESTED, OperatingPoint, Piece
from stickslip_ros.physics.model import Plant
from stickslip_ros.physics.model.waveforms import command_of
from stickslip_ros.physics.parameters import ParameterError, Parameters
from stickslip_ros.physics.solver.driven import simulation_of

#: Cycles that are solved, after which they repeat; of these the last are the mean
_CYCLES, _MEAN = 16, 4
#: s between points of a cycle, of which there are fewest to most; points in the rest after it
_SPACING, _FEWEST, _MOST, _RESTING = 1.25e-5, 100, 800, 2000
#: Width of the mean in periods of the ringing, of which it leaves a thousandth
_WIDTH = 0.6
#: Change of a logarithm for a derivative, in either direction
_CHANGE = 0.02


class Blur(NamedTuple):
    """How a reading differs from a curve that leaves the ringing out."""

    timing: float = 0.0  #: deviation (m) that the uncertain time makes
    ringing: float = 0.0  #: root mean square of the ringing, m
    turned: float = 0.0  #: of its phase since the slip
    coherence: float = 0.0  #: what the uncertain time leaves of what two readings have in common


@dataclass(frozen=True)
class CycleCurve:
    """Position over the cycles of a drive, from the rest before them."""

    x: Array  #: m, (points,) at parts of cycles
    rest: Array  #: m, (points,) over the rest after the last cycle, from its end on
    step: float  #: m, of a settled cycle, with its sign
    ringing: Array  #: m, root mean square of what the mean leaves out, at parts of cycles
    rest_ringing: Array  #: m, the same over the rest
    ringing_frequency: float  #: Hz

    @classmethod
    def of(cls, p: Parameters, drive: OperatingPoint) -> CycleCurve:
        """Solve the cycles of a drive after as many in the direction before, and a rest."""
        p = p.replace(amplitude=drive.amplitude, frequency=drive.frequency)
        simulation = simulation_of(p, Plant.of(p))
        simulation.start(command_of(p, drive.before or drive.direction), _CYCLES)
        simulation.advance(simulation.end_of_move + RESTED)
        begin, start, ringing = simulation.t, simulation.x, simulation.plant.ringing_frequency
        points = min(max(round(1.0 / (drive.frequency * _SPACING)), _FEWEST), _MOST)
        # One cycle more, so that the mean at the end of those solved has what follows.
        simulation.start(command_of(p, drive.direction), _CYCLES + 1)
        end, spacing = simulation.end_of_move, RESTED / _RESTING
        cycles = np.linspace(begin, end, (_CYCLES + 1) * points + 1)
        x = simulation.sample(cycles).x - start
        ahead = math.ceil(4.0 / (ringing * spacing)) if ringing > 0.0 else 1
        after = end + spacing * np.arange(-ahead, _RESTING + 1, dtype=np.float64)
        step = float(x[-1] - x[-1 - _MEAN * points]) / _MEAN
        rest = np.append(
            np.interp(after[:ahead], cycles, x), simulation.sample(after[ahead:]).x - start
        )
        smooth, left = _smooth(x, ringing * float(cycles[1] - cycles[0]))
        smooth[0] = x[0]  # at rest nothing rings
        still, moving = _smooth(rest, ringing * spacing)
        kept = _CYCLES * points + 1
        return cls(
            smooth[:kept],
            still[ahead:] - smooth[kept - 1] - step,
            step,
            left[:kept],
            moving[ahead:],
            ringing,
        )

    def at(self, cycles: Array, rest: Array) -> Array:
        """Return positions (m) after cycles and a rest (s) behind them, (times,)."""
        within = _within(cycles)
        x = _between(self.x, within / _CYCLES) + self.step * (cycles - within)
        return np.asarray(x + _between(self.rest, np.minimum(rest / RESTED, 1.0)) * (rest > 0.0))

    @property
    def lasting(self) -> float:
        """Root mean square of the ringing shortly before the next slip, m."""
        return float(self.ringing[-1 - len(self.ringing) // (10 * _CYCLES)])

    def blur(self, piece: Piece, t: float, timing: float) -> Blur:
        """Return the blur of a reading at t (s) by ringing and an uncertain time.

        timing is the deviation of the time, s.
        """
        assert piece.drive
        cycles, rest = parts_of_cycles(piece, t, max(t - timing, piece.start), t + timing)
        since, ringing = float(rest[0]), _between(self.rest_ringing, np.minimum(rest / RESTED, 1.0))
        if since == 0.0:
            since = float(cycles[0] % 1.0) / piece.drive.frequency
            ringing = _between(self.ringing, _within(cycles) / _CYCLES)
        omega = 2.0 * math.pi * self.ringing_frequency
        width, coherence = float(np.ptp(self.at(cycles, rest))), math.exp(-((omega * timing) ** 2))
        return Blur(0.5 * width, float(ringing[0]), omega * since, coherence)


@lru_cache(4096)
def settled_step(p: Parameters, drive: OperatingPoint) -> float:
    """Return the step (m) of an axis after many at a drive."""
    p = p.replace(amplitude=drive.amplitude, frequency=drive.frequency)
    simulation = simulation_of(p, Plant.of(p))
    simulation.start(command_of(p, drive.direction), _CYCLES + _MEAN)
    simulation.advance(simulation.t + _CYCLES / drive.frequency)
    begin = simulation.x
    simulation.advance(simulation.end_of_move)
    return (simulation.x - begin) / _MEAN


def _within(cycles: Array) -> Array:
    """Return the same place in the last of the cycles solved for those beyond."""
    return np.where(cycles > _CYCLES, _CYCLES - 1 + np.mod(cycles, 1.0), cycles)


def _between(values: Array, place: Array) -> Array:
    """Interpolate values (points,) at places (times,) from 0 to 1."""
    place = place * (len(values) - 1)
    number = np.minimum(place.astype(np.int64), len(values) - 2)
    low = values[number]
    return np.asarray(low + (place - number) * (values[number + 1] - low))


def _smooth(x: Array, part: float) -> tuple[Array, Array]:
    """Return x without ringing, and the deviation from that; part is a period's between points."""
    if part <= 0.0:
        return x, np.zeros_like(x)
    mean = gaussian_filter1d(x, _WIDTH / part, mode="nearest")
    square = gaussian_filter1d((x - mean) ** 2, _WIDTH / part, mode="nearest")
    return mean, np.sqrt(square)


class Model:
    """Curves of a set of parameters and of its neighbours, each made when it is first needed."""

    def __init__(self, p: Parameters) -> None:
        """Take the parameters. Raises ParameterError where no axis has them."""
        Plant.of(p)
        self.p = p
        self._curves: dict[OperatingPoint, CycleCurve] = {}
        self._slopes: dict[tuple[float, float, int], Array] = {}

    @property
    def drives(self) -> list[OperatingPoint]:
        """The drives whose curves were made."""
        return list(self._curves)

    def curve(self, drive: OperatingPoint) -> CycleCurve:
        """Return the curve of a drive."""
        if drive not in self._curves:
            self._curves[drive] = CycleCurve.of(self.p, drive)
        return self._curves[drive]

    def slopes(self, drive: OperatingPoint, names: tuple[str, ...]) -> Array:
        """Return the derivatives (names,) of a drive's step by the logarithms of parameters, m.

        The names are those of the first call.
        """
        if drive[:3] not in self._slopes:
            found = []
            for name in names:
                # At the end of what its law allows a parameter changes in one direction alone.
                near = [(by, self.moved({name: by})) for by in (_CHANGE, 0.0, -_CHANGE)]
                (above, upper), *_, (below, lower) = [one for one in near if one[1]]
                assert upper and lower
                up, down = (settled_step(one.p, drive) for one in (upper, lower))
                found.append((up - down) / (above - below))
            self._slopes[drive[:3]] = np.array(found)
        return self._slopes[drive[:3]]

    def moved(self, changes: Mapping[str, float]) -> Model | None:
        """Return the model with logarithms of parameters changed, None where no axis has them."""
        values = {n: float(self.p.value(n)) * math.exp(by) for n, by in changes.items()}
        try:
            return Model(self.p.replace(**values))
        except ParameterError:
            return None


def parts_of_cycles(piece: Piece, *times: float) -> tuple[Array, Array]:
    """Return the cycles of a piece done at times (s), and the rest (s) behind them."""
    cycles = np.array([piece.cycles_at(t) for t in times])
    rest = np.array([max(t - piece.end, 0.0) if piece.rests else 0.0 for t in times])
    return cycles, rest
