# SPDX-License-Identifier: Apache-2.0
"""Breakaway that knows dwell and rate, against an integrator of its own, and by hand."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from reference import z_rate_and_force
from scipy.integrate import DOP853
from table_1 import table_1

from stickslip_ros.model import DriveCycle, Plant, drive_of
from stickslip_ros.model.waveforms import command_of
from stickslip_ros.parameters import Parameters
from stickslip_ros.solver import Simulation
from stickslip_ros.solver.driven import DrivenSimulation, simulation_of
from stickslip_ros.studies.operating_points import steps_of
from stickslip_ros.studies.zero_amplitude import zero_amplitudes
from stickslip_ros.traces import run_steps

pytestmark = pytest.mark.usefixtures("compiled_solver")

AGEING: dict[str, Any] = {"dwell_growth": 0.06, "dwell_start": 1e-5, "rate_growth": -0.02}


def _aged(p: Parameters, dwell: float, rate: float) -> Plant:
    """The law once more: distances grow with the logarithms of dwell (s) and rate (m/s)."""
    f, plant = p.friction, Plant.of(p)
    factor = 1.0 + f.dwell_growth * math.log(1.0 + dwell / f.dwell_start) / math.log(10.0)
    factor += f.rate_growth * math.log(1.0 + rate / f.rate_start) / math.log(10.0)
    c = plant.contact
    distances = {name: factor * getattr(c, name) for name in ("z_ba", "z_ss", "z_k", "z_s")}
    return plant._replace(contact=c._replace(**distances))


def _positions(p: Parameters, cycle: DriveCycle, moves: list[tuple[int, float]]) -> list[float]:
    """Return x (m) after each cycle; moves are cycles, and a rest (s) after them."""
    y, now, slipped, found = np.zeros(3), 0.0, 0.0, []
    begins = float(cycle.durations[: cycle.slip].sum())
    rate = abs(float(cycle.rates[cycle.slip]))

    def run(duration: float, u_rate: float, plant: Plant) -> None:
        nonlocal y

        def rates(_: float, y: np.ndarray) -> list[float]:
            z_rate, force = z_rate_and_force(y[2] * 1e-9, y[1] * 1e-4 - u_rate, plant.contact)
            return [y[1] * 1e5, -force / plant.mass * 1e4, z_rate * 1e9]

        longest = min(2e-7, 2e-9 / abs(u_rate) if u_rate else math.inf)
        solver = DOP853(rates, 0.0, y, duration, max_step=longest, rtol=1e-10, atol=1e-10)
        while solver.status == "running":
            solver.step()
        y = solver.y

    for count, rest in moves:
        for _ in range(count):
            plant = _aged(p, now + begins - slipped, rate)
            for duration, u_rate in zip(cycle.durations, cycle.rates, strict=True):
                run(float(duration), float(u_rate), plant)
            now, slipped = now + cycle.period, now + begins + float(cycle.slip_duration)
            found.append(float(y[0]) * 1e-9)
        if rest:
            run(rest, 0.0, plant)
            now += rest
    return found


@pytest.mark.parametrize("seed", range(4))
def test_runs_with_rests_agree_with_an_integrator(seed: int) -> None:
    """To 0.01 nm a cycle: a rest makes the next slip start from a stronger contact."""
    random = np.random.default_rng(seed)
    p = table_1(
        frequency=float(random.uniform(5e3, 1.2e4)),
        preload=float(random.uniform(0.3, 1.5)),
        slewrate=float(random.uniform(80.0, 300.0)),
        dwell_growth=float(random.uniform(0.02, 0.15)),
        dwell_start=float(10.0 ** random.uniform(-6.0, -4.0)),
        rate_growth=float(random.uniform(-0.03, 0.05)),
    )
    cycle, rest = drive_of(p), 3e-4
    simulation = simulation_of(p, Plant.of(p))
    found: list[float] = []
    for count in (2, 2):
        simulation.start(cycle, count)
        found += simulation.run_cycles(count).position.tolist()
        simulation.advance(simulation.t + rest)
    assert found == pytest.approx(_positions(p, cycle, [(2, rest), (2, 0.0)]), abs=4e-11)


def test_the_contact_of_each_cycle_is_that_of_its_dwell_and_rate() -> None:
    p = table_1(**AGEING, frequency=1e3)
    cycle = drive_of(p)
    simulation = simulation_of(p, Plant.of(p))
    rate, begins = abs(float(cycle.rates[1])), float(cycle.durations[0])

    def z_ba(dwell: float) -> float:
        return _aged(p, dwell, rate).contact.z_ba

    simulation.start(cycle, 5)
    assert simulation.plant.contact.z_ba == pytest.approx(z_ba(begins), rel=1e-12)
    simulation.run_cycles(3)
    assert simulation.plant.contact.z_ba == pytest.approx(z_ba(begins), rel=1e-9)
    simulation.advance(0.0035)  # in the fourth cycle, before its slip
    simulation.start(cycle, 0)
    simulation.advance(0.1)
    simulation.start(cycle, 1)
    assert simulation.plant.contact.z_ba == pytest.approx(z_ba(0.097 + begins), rel=1e-9)
    assert z_ba(0.097 + begins) > 1.1 * z_ba(begins)


def test_without_growth_there_is_the_plain_model_and_with_little_nearly() -> None:
    """To the bit without, to 1e-4 nm a cycle with little."""
    p = table_1(dwell_start=1e-3, rate_start=1e-6)
    assert type(simulation_of(p, Plant.of(p))) is Simulation
    plain = simulation_of(p, Plant.of(p))
    plain.start(drive_of(p), 10)
    expected = plain.run_cycles(10).position
    for little in ({"dwell_growth": 1e-9}, {"rate_growth": 1e-9}):
        nearly = table_1(**little)
        simulation = simulation_of(nearly, Plant.of(nearly))
        assert type(simulation) is DrivenSimulation
        simulation.start(command_of(nearly), 10)
        assert simulation.run_cycles(10).position == pytest.approx(expected, abs=1e-12)


def test_energy_is_never_created() -> None:
    p = table_1(**AGEING, frequency=5e3)
    simulation = simulation_of(p, Plant.of(p))
    for rest in (1e-5, 1e-2, 1.0):
        simulation.start(drive_of(p), 20)
        assert (simulation.run_cycles(20).lost > 0.0).all()
        simulation.advance(simulation.t + rest)


def test_sweeps_and_the_0_amplitude_know_dwell_and_rate() -> None:
    """A batch has the contact of each run; the direct 0-amplitude of Fig. 7 rises with the slew."""
    p = table_1(rate_growth=0.05, dwell_growth=0.03)
    frequencies = np.array([100.0, 1e3, 4e3])
    step, _ = steps_of(p.replace(frequency=frequencies), 3, 10)
    runs = [run_steps(p.replace(frequency=float(f)), 10).step_size for f in frequencies]
    assert step == pytest.approx(runs, abs=1e-12)
    slewrates = np.array([50.0, 150.0, 500.0])
    plain, aged = (zero_amplitudes(q.replace(slewrate=slewrates), 3, 8) for q in (table_1(), p))
    assert (np.diff(aged) > 2e-10).all()
    assert (np.diff(plain) <= 1e-10).all()
