# SPDX-License-Identifier: Apache-2.0
"""Our kernel, called as everything else in the project calls it."""

from __future__ import annotations

from stickslip_ros.benchmark.cases import Problem
from stickslip_ros.benchmark.method import Run
from stickslip_ros.parameters import SolverParameters

#: m
DEFAULT_TOLERANCE = SolverParameters().tolerance


class Ours:
    """`Simulation` at a tolerance in m. Every cycle is integrated, none is replayed."""

    settings = tuple(
        sorted({1e-9, 1e-10, 1e-11, 1e-12, 1e-13, 1e-14, DEFAULT_TOLERANCE}, reverse=True)
    )

    def prepare(self, problem: Problem, setting: float, cycle: int, count: int) -> Run:
        """Return a run of count cycles from the start of a measured cycle, ready to be timed."""
        simulation = problem.simulation(cycle)
        simulation.set_plant(problem.plant, setting)
        before = problem.starts[cycle].x

        def run() -> float:
            return float(simulation.run_cycles(count).position[-1]) - before

        return run
