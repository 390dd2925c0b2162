# SPDX-License-Identifier: Apache-2.0
"""Motion put together by hand, cycle by cycle, to hold an axis against."""

from __future__ import annotations

from typing import Any

from table_1 import table_1

from stickslip_ros.physics.model import Plant, drive_of
from stickslip_ros.physics.solver import Simulation, State


class Cycles:
    """The expected motion: cycles, one after the other."""

    def __init__(self, start: float = 0.0, **parameters: Any) -> None:
        self.p = table_1(**parameters)
        self.sim = Simulation(Plant.of(self.p), self.p.solver.tolerance)
        self.sim.advance(start)

    def run(self, steps: int, **changes: Any) -> Cycles:
        """Run steps (sign: direction) after parameters were changed."""
        self.p = self.p.replace(**changes)
        self.sim.set_plant(Plant.of(self.p), self.p.solver.tolerance)
        self.sim.start(drive_of(self.p, 1 if steps > 0 else -1), abs(steps))
        self.sim.run_cycles(abs(steps))
        return self

    def rest(self, t: float) -> State:
        self.sim.advance(t)
        return self.sim.state
