# SPDX-License-Identifier: Apache-2.0
"""The answers that a run is a sum of, by an integrator that shares no code with them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from stickslip_ros.traces.ringing import Ringing
from stickslip_ros.traces.slip_onset import PUSH
from stickslip_ros.traces.slip_train import _answers

Array = NDArray[np.float64]
PERIOD = 1e-3
SLIPS: Array = np.array([0.2e-3, 1.2e-3, 2.2e-3, 3.2e-3])  # s
EDGES: Array = np.concatenate(
    (np.linspace(0.0, 5e-3, 60), [9e-3])
)  # the last cell is longer than a cycle


@pytest.mark.parametrize(("frequency", "decay"), [(4100.0, 600.0), (7300.0, 2500.0)])
def test_answers_to_rises_and_drops_are_those_of_an_integrator(
    frequency: float, decay: float
) -> None:
    """x'' + 2 delta (x' - y') + omega_0^2 (x - y) = 0 under y that rises or drops by 1."""
    omega = 2.0 * math.pi * frequency
    stiffness = omega**2 + decay**2

    def means(begin: float, end: float, level: float, kick: float) -> Array:
        """Cell means of x: y is level at begin, 1 from end on; x' begins with kick."""
        rate = (1.0 - level) / (end - begin)
        state, since = np.array([0.0, kick, 0.0]), begin
        total = np.zeros(len(EDGES))  # integral of x up to each edge
        for stop, speed in ((end, rate), (EDGES[-1], 0.0)):

            def slope(t: float, now: Array, speed: float = speed) -> list[float]:
                place = level + rate * (min(t, end) - begin)
                pull = 2.0 * decay * (now[1] - speed) + stiffness * (now[0] - place)
                return [now[1], -pull, now[0]]

            options = {"method": "DOP853", "rtol": 1e-9, "atol": 1e-12, "dense_output": True}
            found = solve_ivp(slope, (since, stop), state, **options)
            total = np.where(since < EDGES, found.sol(np.clip(EDGES, since, stop))[2], total)
            state, since = found.y[:, -1], stop
        return np.diff(total) / np.diff(EDGES)

    rises, falls = _answers(EDGES, SLIPS, PERIOD, Ringing(frequency, decay))
    assert rises.shape == falls.shape == (len(SLIPS), len(EDGES) - 1)
    for number in (1, 2, 3):
        begin, end = SLIPS[number - 1], SLIPS[number]
        assert rises[number] == pytest.approx(means(begin, end, 0.0, 0.0), abs=1e-7)
        # A drop pushes the runner through the damping, by as much as slip_onset takes it to.
        drop = means(end, end + 1e-4, 1.0, (1.0 + PUSH) * decay)
        assert falls[number] == pytest.approx(drop, abs=1e-7)
