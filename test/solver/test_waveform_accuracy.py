# SPDX-License-Identifier: Apache-2.0
"""Every waveform and the actuator with hysteresis against a general integrator."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from reference import integrate
from table_1 import table_1

from stickslip_ros.model import Plant, drive_of
from stickslip_ros.solver import Simulation


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(
    "values",
    [
        {"waveform": "hold", "hold_before": 0.35, "hold_after": 0.1},
        {"waveform": "shaped", "split": 0.7, "latency": 2e-5, "hold_before": 0.1},
        {"waveform": "triangle", "preload": 0.1},
        {"waveform": "table"},
        {"actuator": "hysteresis"},
        {"waveform": "shaped", "latency": 3e-5, "actuator": "hysteresis", "hysteresis": 0.4},
    ],
    ids=lambda values: ",".join(str(value) for value in values.values()),
)
def test_general_integrator_agrees(values: dict[str, Any], sign: int, tmp_path: Path) -> None:
    """Within a thousandth of a nanometre per cycle; the actuator is back where it began."""
    table = tmp_path / "smooth.csv"
    t = np.linspace(0.0, 1.0, 33)
    levels = np.append(0.5 - 0.5 * np.cos(np.pi * t[:-1] ** 2), 0.0)
    table.write_text("\n".join(map(repr, levels.tolist())))
    p = table_1(**{"frequency": 1e4, "waveform_table": str(table), **values})
    plant, drive_cycle = Plant.of(p), drive_of(p, sign)
    simulation = Simulation(plant, 2e-12)
    simulation.start(drive_cycle, 4)
    found = simulation.run_cycles(4).position
    assert np.abs(found - integrate(p, drive_cycle, 4)).max() < 4 * 1e-12
    assert simulation.state.u == pytest.approx(0.0, abs=1e-20)
