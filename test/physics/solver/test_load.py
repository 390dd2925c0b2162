# SPDX-License-Identifier: Apache-2.0
"""Another plant from any time on: loads that change while the axis runs."""

import itertools
from typing import Any

import numpy as np
import pytest
from reference import follow
from table_1 import table_1

from stickslip_ros.physics.model import Plant, drive_of
from stickslip_ros.physics.solver import Simulation

#: Times (in cycles) and forces (N): within a rise, within a slip, while it rings down
CHANGES = ((0.3, 0.05), (0.97, -0.04), (1.995, 0.02), (2.5, 0.0), (3.0007, 0.06), (3.4, -0.02))


def run(
    values: dict[str, Any], cycles: int, cuts: int = 0, replay: bool = True
) -> tuple[Simulation, list[float]]:
    """Run under CHANGES, cut at random times; return the simulation and x at each change (m)."""
    p = table_1(**values)
    plant, drive_cycle = Plant.of(p), drive_of(p)
    simulation = Simulation(plant, p.solver.tolerance, replay)
    simulation.start(drive_cycle, cycles)
    rng = np.random.default_rng(5)
    found = []
    for cycle, force in (*CHANGES, (float(cycles), 0.0)):
        end = cycle * drive_cycle.period
        for t in np.sort(rng.uniform(simulation.state.t, end, cuts)):
            simulation.advance(float(t))
        simulation.advance(end)
        found.append(simulation.state.x)
        simulation.set_plant(plant._replace(force=force), p.solver.tolerance)
    return simulation, found


@pytest.mark.parametrize(
    "values",
    [
        {"frequency": 5e3},
        {"frequency": 1e4, "spring": 1e6, "preload": 1.0},
        {"frequency": 1e4, "model": "lugre"},
        {"frequency": 1e4, "model": "epm_calc", "preload": 1.0},
    ],
    ids=lambda values: ",".join(f"{k}={v}" for k, v in values.items()),
)
def test_general_integrator_agrees(values: dict[str, Any]) -> None:
    """A force that changes within cycles: the same way to a thousandth of a nanometre."""
    p = table_1(**values)
    drive_cycle = drive_of(p)
    _, found = run(values, 4)
    moments = [cycle * drive_cycle.period for cycle, _ in CHANGES]
    forces = [(t, force) for t, (_, force) in zip(moments, CHANGES, strict=True)]
    expected = follow(p, drive_cycle, [*moments, 4 * drive_cycle.period], forces)
    assert np.abs(np.array(found) - expected).max() < 1e-12


@pytest.mark.parametrize("model", ["ceim", "lugre", "epm_calc"])
@pytest.mark.parametrize("replay", [True, False])
def test_cutting_changes_no_bit(model: str, replay: bool) -> None:
    values = {"model": model, "preload": 1.0, "frequency": 3e3, "spring": 1e4}
    whole, positions = run(values, 60, replay=replay)
    parts, again = run(values, 60, cuts=40, replay=replay)
    assert positions == again
    assert parts.state == whole.state
    assert (parts.last_lost, parts.last_step, parts.backstep) == (
        whole.last_lost,
        whole.last_step,
        whole.backstep,
    )


@pytest.mark.parametrize("cycle", [0.2, 0.9985, 20.0, 37.4])
def test_a_change_leaves_the_present_state_alone(cycle: float) -> None:
    """Also in the middle of cycles that are repeated unsolved; only the force F may jump."""
    p = table_1(frequency=1e3)
    plant, drive_cycle = Plant.of(p), drive_of(p)
    simulation = Simulation(plant, p.solver.tolerance)
    simulation.start(drive_cycle, 100)
    simulation.advance(cycle * drive_cycle.period)
    before = simulation.state
    for force in (0.03, -0.01, 0.0):
        simulation.set_plant(plant._replace(force=force), p.solver.tolerance)
        assert simulation.state == before
        simulation.advance(before.t)
        assert simulation.state == before


def test_energy_balance_under_changing_loads() -> None:
    """Work of actuator and loads goes into motion, springs and heat, whenever the load changes.

    The work is summed up here over samples, piece by piece between changes and kinks.
    """
    values = {"frequency": 2e3, "spring": 2e4}
    p = table_1(**values)
    plant, drive_cycle = Plant.of(p), drive_of(p)
    kinks = [k + e for k in range(4) for e in (0.0, drive_cycle.durations[0] / drive_cycle.period)]
    moments = np.unique([*kinks, *(cycle for cycle, _ in CHANGES), 4.0]) * drive_cycle.period
    simulation = Simulation(plant, p.solver.tolerance)
    simulation.start(drive_cycle, 4)
    changes = {cycle * drive_cycle.period: force for cycle, force in CHANGES}
    on_contact = 0.0
    for start, end in itertools.pairwise(moments):
        if start in changes:
            simulation.advance(start)
            simulation.set_plant(plant._replace(force=changes[start]), p.solver.tolerance)
        times = start + (end - start) * np.linspace(1e-7, 1 - 1e-7, 8001)
        seen = simulation.sample(times)
        power = seen.force * (seen.v - seen.rate)
        on_contact += float(np.sum(0.5 * (power[1:] + power[:-1]) * np.diff(times)))
    stored = 0.5 * plant.contact.sigma_0 * simulation.state.z**2
    lost = _lost_in_cycles(values)
    assert sum(lost) == pytest.approx(on_contact - stored, rel=1e-5)
    assert min(lost) > 0.0


def _lost_in_cycles(values: dict[str, Any]) -> list[float]:
    """Return the energy lost (J) in each cycle under CHANGES."""
    p = table_1(**values)
    plant, drive_cycle = Plant.of(p), drive_of(p)
    simulation = Simulation(plant, p.solver.tolerance)
    simulation.start(drive_cycle, 4)
    changes = list(CHANGES)
    lost = []
    for cycle in range(4):
        while changes and changes[0][0] < cycle + 1:
            at, force = changes.pop(0)
            simulation.advance(at * drive_cycle.period)
            simulation.set_plant(plant._replace(force=force), p.solver.tolerance)
        lost.append(float(simulation.run_cycles(1).lost[0]))
    return lost


def test_extremes_reach_over_a_change() -> None:
    """The largest deflection of a cycle is that of both of its parts."""
    p = table_1(frequency=2e3)
    plant, drive_cycle = Plant.of(p), drive_of(p)
    simulation = Simulation(plant, p.solver.tolerance)
    simulation.start(drive_cycle, 3)
    simulation.run_cycles(1)
    found, begin = [], simulation.state.t
    for part in np.split(np.linspace(0.0, 1.0, 40001)[:-1], [4001, 24001]):
        found.append(simulation.sample(begin + part * drive_cycle.period).z)
        force = 0.2 - float(part[-1]) / 4
        if part[-1] < 0.7:
            simulation.set_plant(plant._replace(force=force), p.solver.tolerance)
    cycles, z = simulation.run_cycles(1), np.concatenate(found)
    assert cycles.z_max[0] == pytest.approx(z.max(), abs=1e-11)
    assert cycles.z_min[0] == pytest.approx(z.min(), abs=1e-11)


def test_replay_waits_for_a_cycle_under_one_plant() -> None:
    """A load that comes at the very end of a steady cycle is not repeated away.

    The cycle that saw it only in its last nanosecond begins and ends as the one before; the next
    one is another.
    """
    p = table_1(frequency=1e3)
    plant, drive_cycle = Plant.of(p), drive_of(p)
    ends = []
    for replay in (True, False):
        simulation = Simulation(plant, p.solver.tolerance, replay)
        simulation.start(drive_cycle, 300)
        simulation.advance(100 * drive_cycle.period - 1e-9)
        simulation.set_plant(plant._replace(force=0.08), p.solver.tolerance)
        simulation.advance(200.5 * drive_cycle.period)
        simulation.set_plant(plant, p.solver.tolerance)
        simulation.run_cycles(300 - simulation.cycles_done)
        ends.append(simulation.state.x)
    assert ends[0] == pytest.approx(ends[1], abs=300 * 2e-12)
