# SPDX-License-Identifier: Apache-2.0
"""Advances the model: the compiled kernel for one axis."""

from stickslip_ros.physics.solver.advance import SolverError
from stickslip_ros.physics.solver.simulation import CycleResults, Samples, Simulation, State

__all__ = ["CycleResults", "Samples", "Simulation", "SolverError", "State"]
