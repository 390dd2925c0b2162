# SPDX-License-Identifier: Apache-2.0
"""A call that takes more work than it may ends with a word; signals get through meanwhile."""

import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from cpu_time import computes_at_most

from stickslip_ros.base.errors import StickslipError
from stickslip_ros.physics.model import Plant, drive_of
from stickslip_ros.physics.parameters import Parameters
from stickslip_ros.physics.solver import Simulation, SolverError, advance


def test_slices_change_no_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    p = Parameters.of({"frequency": 3e3, "model": "epm_fix"})
    runs = []
    for arcs, samples in ((advance.SLICE, advance.SAMPLES), (1, 7)):
        monkeypatch.setattr(advance, "SLICE", arcs)
        monkeypatch.setattr(advance, "SAMPLES", samples)
        simulation = Simulation(Plant.of(p), p.solver.tolerance)
        simulation.start(drive_of(p), 10)
        runs.append(simulation.run_cycles(10).position.tolist())
        simulation.advance(simulation.state.t + 1e-3)
        runs[-1].append(simulation.state.x)
        simulation.start(drive_of(p), 10)
        runs[-1] += simulation.sample(simulation.t + np.linspace(0.0, 4e-3, 101)).x.tolist()
    assert runs[0] == runs[1]


def test_the_library_ends_with_the_cause(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(advance, "SLICE", 5)
    p = Parameters.of({"model": "lugre", "mass": 4e-3, "sigma_1": 1e4, "spring": 1e5})
    simulation = Simulation(Plant.of(p), p.solver.tolerance, budget=10)
    simulation.start(drive_of(p), 3)
    with pytest.raises(SolverError, match=r"sigma_1 / mass is 2\.5e\+06 1/s.*lower that") as caught:
        simulation.run_cycles(3)
    assert isinstance(caught.value, StickslipError)
    assert isinstance(caught.value, ArithmeticError)


def test_a_step_that_is_never_exact_enough_is_not_taken() -> None:
    """A contact renewed by 1e-40 m: at lengths that fit it no time passes, so nothing ends."""
    p = Parameters.of(model="ceim_ageing")
    plant = Plant.of(p)._replace(own=(0.01, 1e-40, 1e-3))
    simulation = Simulation(plant, p.solver.tolerance, budget=5000)
    simulation.start(drive_of(p), 2)
    with pytest.raises(SolverError, match="more than the 5000 arcs"):
        simulation.run_cycles(2)


@pytest.mark.long
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
def test_a_signal_ends_a_long_call_within_a_second(name: str) -> None:
    program = (
        "from stickslip_ros.physics.parameters import Parameters\n"
        "from stickslip_ros.physics.model import Plant, drive_of\n"
        "from stickslip_ros.physics.solver import Simulation, advance\n"
        "advance.PER_CYCLE = 10**12\n"
        "p = Parameters.of({'frequency': 1e4})\n"
        "s = Simulation(Plant.of(p), 1e-11, replay=False)\n"
        "s.start(drive_of(p), 10**9)\n"
        "s.advance(0.01)\n"
        "print('runs', flush=True)\n"
        "s.advance(1e4)\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"runs\n"
        time.sleep(0.3)
        with computes_at_most(2.0, process.pid):
            process.send_signal(getattr(signal, name))
            process.wait(timeout=60)
        assert process.returncode != 0
