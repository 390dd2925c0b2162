# SPDX-License-Identifier: Apache-2.0
"""The travel of the runner: its ends, and the narrower ones that faults on demand may set.

The solver knows two stops. While a fault confines the runner they are not the ends of the travel:
nothing is held there, and no hits are counted.
"""

from __future__ import annotations

from stickslip_ros.axis.config import Config
from stickslip_ros.axis.faults import DIRT
from stickslip_ros.parameters import LimitParameters
from stickslip_ros.solver import Simulation

#: m that a stuck runner has to either side
_STUCK = 1e-12


class Travel:
    """The stops of a simulation."""

    def __init__(self, sim: Simulation, limits: LimitParameters) -> None:
        """Set the stops at the ends of the travel."""
        self._sim = sim
        self._ends = limits.travel_low, limits.travel_high
        self._confined = False
        self._hits = 0  # of the ends of the travel, until the runner was confined
        self._other_hits = 0  # of the narrower ends
        self._stuck_at: float | None = None  # m
        sim.set_stops(*self._ends)

    @property
    def held(self) -> int:
        """The end of the travel that holds the runner: -1 the lower, 1 the upper, 0 none."""
        return 0 if self._confined else self._sim.stopped

    @property
    def hits(self) -> int:
        """How often the runner has hit an end of the travel."""
        return self._hits if self._confined else self._sim.stop_hits - self._other_hits

    def confine(self, config: Config, cycles: int) -> None:
        """Let the runner travel as far as the faults leave it; cycles have run."""
        faults, x, hits = config.faults, self._sim.x, self.hits
        low, high = self._ends
        if DIRT in faults:
            place = faults.value(DIRT) + config.offset
            low, high = (low, min(place, high)) if x <= place else (max(place, low), high)
        if faults.steps_left(cycles):
            self._stuck_at = None
        else:
            self._stuck_at = x if self._stuck_at is None else self._stuck_at
            low, high = max(low, self._stuck_at - _STUCK), min(high, self._stuck_at + _STUCK)
        self._confined = (low, high) != self._ends
        self._hits, self._other_hits = hits, self._sim.stop_hits - hits
        self._sim.set_stops(low, high)
