# SPDX-License-Identifier: Apache-2.0
"""Several contacts under one runner against an integrator of its own, and in their limits."""

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from table_1 import table_1

from stickslip_ros.physics.model import Plant, drive_of
from stickslip_ros.physics.model.waveforms import command_of
from stickslip_ros.physics.parameters import Parameters
from stickslip_ros.physics.solver import Simulation
from stickslip_ros.physics.solver.driven import simulation_of
from stickslip_ros.simulation.operating_points import steps_of
from stickslip_ros.simulation.phases import regime_now
from stickslip_ros.simulation.steps import run_steps
from validation.whole_system import WholeSystem

GUIDE: dict[str, Any] = {"contacts": 6, "contact_shares": "guide"}
UNEQUAL: dict[str, Any] = {**GUIDE, "contact_spread": 0.2}


def _started(p: Parameters, cycles: int, **how: Any) -> Simulation:
    simulation = simulation_of(p, Plant.of(p), **how)
    simulation.start(command_of(p), cycles)
    return simulation


def _random(seed: int) -> Parameters:
    random = np.random.default_rng(seed)

    def between(low: float, high: float) -> float:
        return float(low * (high / low) ** random.random())

    values: dict[str, Any] = {
        "frequency": between(2e3, 1.5e4),
        "amplitude": between(100.0, 300.0),
        "preload": between(0.2, 2.0),
        "mass": between(2e-3, 1.5e-2),
        "slewrate": between(80.0, 500.0),
        "sigma_1": between(1.0, 20.0),
        "contacts": int(random.integers(2, 9)),
        "contact_spread": between(0.01, 0.4),
        "surface_seed": int(random.integers(10**6)),
    }
    if seed % 3 == 0:  # the guide lifts off a runner too heavy for its preload
        values = {**values, **GUIDE, "preload": max(values["preload"], 100.0 * values["mass"])}
    if seed % 4 == 1:
        values["force"] = float(random.uniform(-0.05, 0.05))
    if seed % 4 == 2:
        values["spring"] = between(1e4, 1e6)
    if seed >= 20:  # laws with a Stribeck curve; steps may pass a bend of alpha
        values |= {"model": ("lugre", "epm_fix", "epm_calc")[seed % 3], "z_ba": 2e-8}
        values |= {"z_ss": 1e-7, "mu_s": 0.3, "v_stribeck": between(1e-4, 1e-2)}
        values["tolerance"] = 1e-13
    return table_1(**values)


@pytest.mark.parametrize("seed", range(26))
def test_random_drives_agree_with_an_integrator(seed: int) -> None:
    """To 0.001 nm in two cycles, x and each deflection; measured: at most 0.00001 nm."""
    p = _random(seed)
    simulation, system, cycle, x = _started(p, 2), WholeSystem(p), drive_of(p), []
    for _ in range(2):
        for duration, rate in zip(cycle.durations.tolist(), cycle.rates.tolist(), strict=True):
            system.segment(duration, rate / p.actuator.gain)
        x.append(system.x)
    assert simulation.run_cycles(2).position == pytest.approx(x, abs=1e-12)
    assert simulation.deflections == pytest.approx(system.z, abs=1e-12)


@pytest.mark.parametrize(
    "values",
    [
        {},
        {"frequency": 5e3, "preload": 2.0},
        {"frequency": 1e3, "spring": 1e6, "force": 0.02},
        {"frequency": 1e3, "model": "lugre", "mu_s": 0.2},
        {"frequency": 1e3, "model": "epm_fix", "mu_s": 0.2, "preload": 1.0},
        {"frequency": 1e3, "model": "lugre"},
        {"model": "epm_calc", "preload": 1.0, "spring": 1e6, "tolerance": 1e-13},
        {"frequency": 1e3, "sigma_1": 1000.0},
        {"frequency": 2e3, "amplifier_bandwidth": 2e5, "slip_spread": 0.1, "creep": 0.01},
    ],
)
@pytest.mark.parametrize("contacts", [2, 6])
def test_equal_contacts_are_the_one_contact(values: dict[str, Any], contacts: int) -> None:
    """To 1e-4 nm a cycle: position, backstep, heat and deflection."""
    one, many = (_started(table_1(**values, contacts=n), 12) for n in (1, contacts))
    expected, found = one.run_cycles(12), many.run_cycles(12)
    assert np.diff(found.position) == pytest.approx(np.diff(expected.position), abs=1e-13)
    assert found.backstep[1:] == pytest.approx(expected.backstep[1:], abs=1e-13)
    assert found.lost == pytest.approx(expected.lost, rel=1e-4)
    assert many.deflections == pytest.approx(one.state.z, abs=1e-13)
    assert many.state.force == pytest.approx(one.state.force, abs=1e-6)


def test_a_small_spread_is_nearly_none() -> None:
    """1e-9 of all distances moves a step by less than 1e-4 nm."""
    values = {"frequency": 5e3, "contacts": 6}
    nearly = _started(table_1(**values, contact_spread=1e-9), 12).run_cycles(12).position
    plain = _started(table_1(**values), 12).run_cycles(12).position
    assert np.diff(nearly) == pytest.approx(np.diff(plain), abs=1e-13)


def test_one_contact_takes_the_way_it_always_took() -> None:
    p = table_1(contacts=1, contact_spread=0.3)
    assert Plant.of(p) == Plant.of(table_1())
    assert Plant.of(p).contacts == ()


def test_some_contacts_slide_while_others_stick() -> None:
    """The weak ones of the guide give way first; each keeps its own side of its borders."""
    p = table_1(**UNEQUAL, frequency=1e3)
    simulation = _started(p, 2)
    shares, regimes = [], set()
    for t in np.linspace(0.0, 2e-3, 3001):
        simulation.advance(float(t))
        shares.append(simulation.alpha)
        regimes.add(regime_now(simulation))
    assert regimes >= {"elastic", "mixed"}
    assert 0.0 < max(shares) <= 1.0
    z = simulation.deflections
    assert np.ptp(z) > 5e-9
    c = Plant.of(p).contacts
    sigma_0 = np.array([one.sigma_0 for one in c])
    assert simulation.state.z == pytest.approx(float(sigma_0 @ z / sigma_0.sum()), rel=1e-12)


def test_a_run_in_parts_is_the_run_at_once() -> None:
    """With looks and changes of the plant in the middle of cycles."""
    p = table_1(**UNEQUAL, frequency=2e3)
    parts, looked = (_started(p, 6) for _ in range(2))
    for k in range(6):
        for simulation in (parts, looked):
            if simulation is looked:
                simulation.sample(np.linspace(simulation.t, (k + 0.3) / 2e3, 50))
            simulation.advance((k + 0.37) / 2e3)
            simulation.set_plant(Plant.of(p), p.solver.tolerance)
        assert (parts.deflections == looked.deflections).all()
    ends = [float(simulation.run_cycles(1).position[0]) for simulation in (parts, looked)]
    assert ends[0] == ends[1]
    whole = _started(p, 6).run_cycles(6).position[-1]
    assert ends[0] == pytest.approx(whole, abs=1e-15)


def test_settled_cycles_are_replayed() -> None:
    p = table_1(**UNEQUAL, frequency=2e3)
    replayed, solved = _started(p, 300), _started(p, 300, replay=False)
    x = replayed.run_cycles(300).position
    assert x == pytest.approx(solved.run_cycles(300).position, abs=1e-12)
    assert int(replayed._s["steady"]) == 1
    again = _started(p, 300)
    again.advance(0.1)
    assert again.x == pytest.approx(x[199], abs=1e-15)


def test_a_move_goes_on_from_where_the_contacts_are() -> None:
    """A move begun while the runner still rings takes each deflection along."""
    p = table_1(**UNEQUAL, frequency=2e3)
    simulation = _started(p, 3)
    simulation.run_cycles(3)
    simulation.advance(3 / 2e3 + 3.3e-5)
    before = simulation.deflections
    simulation.start(drive_of(p, -1), 2)
    assert (simulation.deflections == before).all()
    simulation.advance(simulation.t + 1e-9)
    assert simulation.deflections == pytest.approx(before, abs=1e-12)


def test_stops_hold_several_contacts_as_they_hold_one() -> None:
    """Hits and positions of equal contacts are those of one; unequal ones stay between."""
    found = []
    for values in ({}, {"contacts": 3}, UNEQUAL):
        simulation = simulation_of(p := table_1(**values, frequency=2e3), Plant.of(p))
        simulation.set_stops(-1e-7, 3.3e-7)
        simulation.start(drive_of(p), 6)
        forward = simulation.run_cycles(6).position
        simulation.start(drive_of(p, -1), 8)
        back = simulation.run_cycles(8)
        found.append((np.concatenate([forward, back.position]), simulation.stop_hits, back.lost))
        assert found[-1][0].max() <= 3.3e-7
        assert found[-1][0].min() >= -1e-7
        assert simulation.stop_hits > 3
        assert (back.lost > 0.0).all()
    (x, hits, lost), (x_3, hits_3, lost_3), _ = found
    assert x_3 == pytest.approx(x, abs=1e-12)
    assert lost_3 == pytest.approx(lost, rel=1e-4)
    assert hits_3 == hits


def test_energy_of_a_cycle_balances() -> None:
    """Heat is what the actuator does in work on the contacts once the cycle has settled."""
    p = table_1(**UNEQUAL, frequency=5e3)
    simulation = _started(p, 62, replay=False)
    lost = simulation.run_cycles(60).lost[-1]
    kinks = np.append(0.0, np.cumsum(drive_of(p).durations))
    work = 0.0
    for start, end in pairwise(kinks.tolist()):
        t = 60 / 5e3 + np.linspace(start, end, 20_001)
        samples = simulation.sample(np.nextafter(t, t.mean()))
        power = samples.force * samples.rate
        work -= float(np.sum(0.5 * (power[1:] + power[:-1]) * np.diff(t)))
    assert lost == pytest.approx(work, rel=1e-5)


def test_a_sweep_is_each_of_its_runs() -> None:
    preloads = (0.01, 0.3, 1.0)
    for values in (UNEQUAL, {"contacts": 3}):
        column = table_1(**values, frequency=1e3).replace(preload=np.array(preloads))
        step_size, backstep = steps_of(column, 3, 12)
        for k, preload in enumerate(preloads):
            if values is UNEQUAL and k == 0:
                assert math.isnan(step_size[0])  # the runner lifts off the guide
                continue
            run = run_steps(table_1(**values, frequency=1e3, preload=preload), 12)
            assert step_size[k] == run.step_size
            assert backstep[k] == run.backstep


@pytest.mark.parametrize("model", ["ceim", "lugre", "epm_fix"])
def test_a_runner_that_its_load_carries_off_takes_equal_contacts_along(model: str) -> None:
    """For a tenth of a second, over metres: to 1e-9 of the way, and with no more than 1000 arcs."""
    values = {"model": model, "mu_s": 0.2, "preload": 1.0, "force": 0.8}
    found = []
    for contacts in (1, 4):
        simulation = _started(table_1(**values, contacts=contacts), 10)
        x = simulation.run_cycles(10)
        found.append((x.position, x.lost))
        assert int(simulation._s["spent"]) < 1000
    assert found[0][0][-1] > 0.1
    assert found[1][0] == pytest.approx(found[0][0], rel=1e-9)
    assert found[1][1] == pytest.approx(found[0][1], rel=1e-9)
