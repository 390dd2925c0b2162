# SPDX-License-Identifier: Apache-2.0
"""The Prandtl-Ishlinskii operator: hysteresis as a sum of play operators.

A play operator follows the voltage with a backlash r to either side: it moves only while the
voltage pushes one end of its gap. Their weighted sum with the voltage itself is the deflection
(M. A. Krasnosel'skii, A. V. Pokrovskii, Systems with Hysteresis, Springer 1989; for piezo
actuators K. Kuhnen, European Journal of Control 9 (2003) 407). Between the moments in which one
begins to move, the deflection is as straight as the voltage, so a solver for straight pieces runs
it exactly.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

#: Pieces of a segment shorter than this share of it are not told apart from its ends.
_SHORTEST = 1e-9


def _none() -> NDArray[np.float64]:
    return np.empty(0)


@dataclass(frozen=True)
class Actuator:
    """Deflection = elastic * voltage + sum of weights * plays, m; linear without plays."""

    elastic: float  #: m/V
    thresholds: NDArray[np.float64] = field(default_factory=_none)  #: r (V), (operators,)
    weights: NDArray[np.float64] = field(default_factory=_none)  #: m/V, (operators,)

    @property
    def is_linear(self) -> bool:
        """True if the deflection at a voltage is always the same."""
        return not self.weights.any()

    def rest(self) -> Memory:
        """Return the memory at 0 V without a past: every play in the middle."""
        return Memory(0.0, np.zeros(len(self.thresholds)))

    def deflection(self, memory: Memory) -> float:
        """Return the deflection (m)."""
        return float(self.elastic * memory.volts + self.weights @ memory.plays)

    def stroke(self, volts: float) -> float:
        """Return the stroke (m) of the closed loop between 0 and volts (V)."""
        moved = np.maximum(volts - 2.0 * self.thresholds, 0.0)
        return float(self.elastic * volts + self.weights @ moved)

    def volts_for(self, stroke: float) -> float:
        """Return the voltage (V) of the closed loop from 0 that has a stroke (m)."""
        if self.is_linear:
            return stroke / self.elastic
        kinks = [0.0, *np.sort(2.0 * self.thresholds).tolist()]
        start = [volts for volts in kinks if self.stroke(volts) <= stroke][-1]
        slope = self.elastic + float(self.weights[2.0 * self.thresholds <= start].sum())
        return start + (stroke - self.stroke(start)) / slope


@dataclass(frozen=True)
class Memory:
    """What an actuator remembers of its past: the voltage and where its plays stand, V."""

    volts: float
    plays: NDArray[np.float64]  #: (operators,)

    def moved(self, volts: float, thresholds: NDArray[np.float64]) -> Memory:
        """Return the memory after the voltage went straight to volts."""
        plays = np.maximum(volts - thresholds, np.minimum(volts + thresholds, self.plays))
        return Memory(volts, plays)


def follow(
    actuator: Actuator,
    memory: Memory,
    durations: NDArray[np.float64],
    volt_rates: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], Memory]:
    """Return durations (s) and rates (m/s) of the deflection, and the memory after it.

    durations (s) and volt_rates (V/s) of the voltage have shape (segments,). A segment in which
    plays begin to move becomes several; none takes no time.
    """
    spans: list[float] = []
    rates: list[float] = []
    for duration, volt_rate in zip(durations.tolist(), volt_rates.tolist(), strict=True):
        pieces, memory = path_of(actuator, memory, duration, volt_rate)
        spans += [span for span, _ in pieces]
        rates += [rate for _, rate in pieces]
    return np.array(spans), np.array(rates), memory


def path_of(
    actuator: Actuator, memory: Memory, duration: float, volt_rate: float
) -> tuple[list[tuple[float, float]], Memory]:
    """Return duration (s) and rate (m/s) of each straight piece of one voltage segment."""
    way = duration * volt_rate
    after = memory.moved(memory.volts + way, actuator.thresholds)
    if actuator.is_linear or way == 0.0:
        return [(duration, actuator.elastic * volt_rate)], after
    direction = 1.0 if way > 0.0 else -1.0
    # Each play is pushed from where the voltage has gone this share of its way.
    gap = memory.plays + direction * actuator.thresholds - memory.volts
    shares = np.clip(gap / way, 0.0, 1.0)
    kinks = [0.0]
    for share in np.sort(shares).tolist():
        if share > kinks[-1] + _SHORTEST and share < 1.0 - _SHORTEST:
            kinks.append(share)
    kinks.append(1.0)
    pieces = []
    here = memory
    for start, end in pairwise(kinks):
        there = after if end == 1.0 else memory.moved(memory.volts + end * way, actuator.thresholds)
        span = (end - start) * duration
        change = actuator.deflection(there) - actuator.deflection(here)
        pieces.append((span, change / span))
        here = there
    return pieces, after
