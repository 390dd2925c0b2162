# SPDX-License-Identifier: Apache-2.0
"""Travel stops: never passed, held against while pressed, left when the force turns."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some
from reference import follow_between, heat_of, states_at
from table_1 import table_1

from stickslip_ros.physics.model import DriveCycle, Plant, drive_of, ramp
from stickslip_ros.physics.parameters import Parameters
from stickslip_ros.physics.solver import Simulation


def between(p: Parameters, low: float, high: float, replay: bool = True) -> Simulation:
    simulation = Simulation(Plant.of(p), p.solver.tolerance, replay)
    simulation.set_stops(low, high)
    return simulation


@pytest.mark.parametrize("model", ["ceim", "lugre"])
@pytest.mark.parametrize("frequency", [1e3, pytest.param(100.0, marks=pytest.mark.long)])
@pytest.mark.parametrize(
    "values", [{}, {"spring": 3e5, "sigma_2": 2.0, "force": 0.02}], ids=["plain", "loaded"]
)
def test_general_integrator_agrees(model: str, frequency: float, values: dict[str, Any]) -> None:
    """Into a stop within the first rise, held, pulled off by slips, and against it again."""
    p = table_1(**{"model": model, "frequency": frequency, **values})
    plant, drive_cycle = Plant.of(p), drive_of(p)
    times = np.sort(np.append(np.linspace(0.05, 1.95, 39), [0.9999, 2.0])) * drive_cycle.period
    simulation = between(p, -1e-6, 90e-9)
    simulation.start(drive_cycle, 2)
    found = [state.x for state in states_at(simulation, times)]
    expected, hits = follow_between(plant, drive_cycle, list(times), -1e-6, 90e-9)
    assert np.abs(found - expected).max() < 1e-11
    assert simulation.stop_hits == hits
    assert hits > 1


@pytest.mark.parametrize("model", ["ceim", "lugre", "epm_fix"])
@pytest.mark.parametrize("sign", [1, -1])
def test_steps_into_a_stop_and_away_from_it(model: str, sign: int) -> None:
    """No sample lies beyond; steps the other way are those of a runner that starts there."""
    p = table_1(model=model, preload=1.0, frequency=2e3)
    stop = sign * 60e-9
    simulation = between(p, min(stop, -sign * 1.0), max(stop, -sign * 1.0))
    simulation.start(drive_of(p, sign), 40)
    position = simulation.sample(np.linspace(0.0, 40 / 2e3, 8001)[1:]).x
    assert (sign * position <= sign * stop).all()
    assert (position == stop).sum() > 1000  # most of the time it is held there
    assert simulation.stop_hits >= 1
    simulation.advance(0.1)
    simulation.start(drive_of(p, -sign), 60)
    away = simulation.run_cycles(60).position
    free = Simulation(Plant.of(p), p.solver.tolerance)
    free.start(drive_of(p, -sign), 60)
    expected = free.run_cycles(60).position
    assert sign * (stop - away[-1]) > 0.9 * abs(expected[-1])
    assert simulation.stopped == 0
    np.testing.assert_allclose(np.diff(away)[20:], np.diff(expected)[20:], atol=2e-12)


def test_gravity_holds_the_runner_against_a_stop() -> None:
    """Steeper than the contact can hold, the runner slides down onto the stop and stays."""
    p = table_1(inclination=math.pi / 2, payload=0.1)
    plant = Plant.of(p)
    simulation = between(p, -1e-3, 1e-3)
    simulation.advance(0.5)
    assert simulation.state.x == -1e-3
    assert simulation.state.v == 0.0
    assert (simulation.stopped, simulation.stop_hits) == (-1, 1)
    # a push from below lifts it off, to the other stop
    simulation.set_plant(plant._replace(force=1.0), p.solver.tolerance)
    simulation.advance(0.5 + 1e-3)
    assert (simulation.stopped, simulation.stop_hits) == (0, 1)
    assert simulation.state.x > -1e-3
    simulation.advance(1.0)
    assert (simulation.stopped, simulation.state.x) == (1, 1e-3)


def test_a_free_fall_takes_the_time_that_it_should() -> None:
    """Far above what friction holds: half g t^2, so the hit has its time."""
    p = table_1(preload=1e-3, model="lugre")
    plant = Plant.of(p)._replace(force=5.0)
    simulation = Simulation(plant, p.solver.tolerance)
    simulation.set_stops(high=2e-3)
    net = 5.0 - plant.contact.sigma_0 * plant.contact.z_k
    hit = math.sqrt(2.0 * 2e-3 * plant.mass / net)
    simulation.advance(0.999 * hit)
    assert simulation.stopped == 0
    assert simulation.state.x == pytest.approx(0.999**2 * 2e-3, rel=1e-3)
    simulation.advance(1.001 * hit)
    assert simulation.stopped == 1


@settings(max_examples=25, deadline=None)
@given(
    model=some.sampled_from(["ceim", "lugre", "epm_fix", "epm_calc"]),
    frequency=some.floats(2.0, 4.3).map(lambda e: 10.0**e),
    low=some.floats(0.0, 300e-9),
    high=some.floats(1e-9, 300e-9),
    force=some.sampled_from([0.0, 0.03, -0.1, 3.0]),
    spring=some.sampled_from([0.0, 1e5]),
    sigma_2=some.sampled_from([0.0, 2.0]),
    sign=some.sampled_from([1, -1]),
    seed=some.integers(0, 1000),
)
def test_never_beyond_and_however_cut(
    model: str,
    frequency: float,
    low: float,
    high: float,
    force: float,
    spring: float,
    sigma_2: float,
    sign: int,
    seed: int,
) -> None:
    """Whatever the drive and load: no sample beyond a stop, and cutting changes no bit."""
    loads = {"force": force, "spring": spring, "sigma_2": sigma_2}
    p = table_1(**{"model": model, "preload": 1.0, "frequency": frequency, **loads})
    drive_cycle = drive_of(p, sign)
    rng = np.random.default_rng(seed)
    runs = []
    for cuts in (0, 150):
        simulation = between(p, -low, high)
        for count, way in ((5, drive_cycle), (1, ramp(-sign * 80e-9, 1e-3)), (3, drive_cycle)):
            start = simulation.state.t
            simulation.start(way, count)
            end = start + count * way.period * 1.1
            for t in np.sort(rng.uniform(start, end, cuts)):
                simulation.advance(float(t))
                assert -low <= simulation.state.x <= high
                if simulation.stopped:
                    assert simulation.state.v == 0.0
                    assert simulation.state.x == (high if simulation.stopped > 0 else -low)
            simulation.advance(end)
        runs.append((simulation.state, simulation.stop_hits, simulation.stopped))
    assert runs[0] == runs[1]


@pytest.mark.parametrize("model", ["ceim", "lugre"])
def test_far_stops_change_no_bit(model: str) -> None:
    p = table_1(model=model, frequency=1e3)
    ends = []
    for stop in (20e-6, math.inf):
        simulation = between(p, -stop, stop)
        simulation.start(drive_of(p), 100)
        simulation.run_cycles(100)
        simulation.advance(0.3)
        ends.append(simulation.state)
    assert ends[0] == ends[1]


@pytest.mark.parametrize("model", ["ceim", "lugre"])
def test_replay_does_not_step_over_a_stop(model: str) -> None:
    """Steady cycles are repeated up to near the stop, and solved from there on."""
    p = table_1(model=model, frequency=1e3)
    ends = []
    for replay in (True, False):
        simulation = between(p, -1e-6, 10e-6, replay)
        simulation.start(drive_of(p), 300)
        cycles = simulation.run_cycles(300)
        assert cycles.position.max() <= 10e-6
        ends.append(cycles.position)
    np.testing.assert_allclose(ends[0], ends[1], rtol=0.0, atol=300 * 2e-12)
    assert ends[0][-1] > 9.8e-6


def test_energy_lost_against_a_stop_is_that_of_the_contact() -> None:
    """The heat of the contact, summed up over samples; what goes into the stop is left out."""
    p = table_1(frequency=2e3)
    drive_cycle = drive_of(p)
    simulation = between(p, -1e-6, 60e-9, replay=False)
    simulation.start(drive_cycle, 4)
    kinks = np.append(0.0, np.cumsum(np.tile(drive_cycle.durations, 4)))
    heat = heat_of(simulation, kinks.tolist(), 40001)
    again = between(p, -1e-6, 60e-9)
    again.start(drive_cycle, 4)
    lost = again.run_cycles(4).lost
    assert lost.sum() == pytest.approx(heat, rel=1e-4)
    assert again.stop_hits > 3


def test_no_backstep_of_a_runner_that_stands() -> None:
    """Pressed against the lower stop through the whole cycle it does not step, nor back."""
    p = table_1(frequency=1e3, force=-1.0)
    simulation = between(p, 0.0, 1e-6)
    simulation.start(drive_of(p), 5)
    cycles = simulation.run_cycles(5)
    assert (cycles.position == 0.0).all()
    assert (cycles.backstep[1:] == 0.0).all()
    assert simulation.stopped == -1
    simulation.advance(6e-3)
    assert not simulation.stepping_back


def test_stops_stand_on_either_side_of_the_runner() -> None:
    """Refused with nothing changed; moved away from a runner that is held they let it go."""
    p = table_1(frequency=1e3)
    simulation = between(p, -1e-6, 50e-9)
    simulation.start(ramp(100e-9, 1e-2), 1)
    simulation.advance(9e-3)
    assert simulation.stopped == 1
    for low, high in ((0.0, 40e-9), (60e-9, 1e-6), (50e-9, 50e-9), (math.nan, 1.0)):
        with pytest.raises(ValueError, match=r"runner is at 5e-08 m, the stops at"):
            simulation.set_stops(low, high)
    simulation.advance(9.5e-3)
    assert (simulation.stopped, simulation.state.x) == (1, 50e-9)
    simulation.set_stops()
    simulation.advance(1e-2)
    assert simulation.stopped == 0
    assert simulation.state.x > 51e-9


def test_a_peak_that_only_grazes_a_stop_is_found() -> None:
    """It lies beyond the stop for a fortieth of what counts as a short arc."""
    p = table_1(sigma_1=0.0)
    plant = Plant.of(p)
    omega = math.sqrt(plant.contact.sigma_0 / plant.mass)
    kick = DriveCycle(np.array([2e-3]), np.array([10e-9 * omega]), slip=-1, sign=1)
    times = np.linspace(0.0, 4e-3, 40001)[1:]
    free = Simulation(plant, p.solver.tolerance)
    free.start(kick, 1)
    top = float(free.sample(times).x.max())
    for above, found in ((1e-13, False), (-1e-13, True)):
        simulation = Simulation(plant, p.solver.tolerance)
        simulation.set_stops(high=top + above)
        simulation.start(kick, 1)
        simulation.advance(4e-3)
        assert (simulation.stop_hits > 0) == found
