# SPDX-License-Identifier: Apache-2.0
"""What must hold for every run: symmetry, energy, independence of how it is cut up or sampled."""

import copy
import math
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as some
from reference import follow, heat_of, states_at
from table_1 import table_1

from stickslip_ros.physics.model import DriveCycle, Plant, drive_of, ramp, sawtooth, z_rate
from stickslip_ros.physics.parameters import ParameterError
from stickslip_ros.physics.solver import Simulation

#: Six contacts of which each gives way at another deflection
UNEQUAL = {"contacts": 6, "contact_shares": "guide", "contact_spread": 0.2}
LAWS = ("ceim", "ceim_without_mu", "lugre", "epm_fix")


def simulation_of(
    values: dict[str, Any], sign: int = 1, replay: bool = True
) -> tuple[Simulation, DriveCycle]:
    """Return a simulation at rest and the drive cycle that the values describe."""
    p = table_1(**values)
    return Simulation(Plant.of(p), p.solver.tolerance, replay), drive_of(p, sign)


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))])
def test_a_copy_goes_on_by_itself(copied: Callable[[Simulation], Simulation]) -> None:
    """Over more arcs than the kernel takes at a time, which the copy has to count for itself."""
    simulation, drive_cycle = simulation_of({"frequency": 18.5e3}, replay=False)
    simulation.start(drive_cycle, 5000)
    simulation.run_cycles(20)
    other = copied(simulation)
    ours, theirs = simulation.run_cycles(4000), other.run_cycles(4000)
    np.testing.assert_array_equal(theirs.position, ours.position)
    assert other.state == simulation.state
    assert other.cycles_done == 4020


@pytest.mark.parametrize("ratio", [0.5, 0.7, 0.9])
@pytest.mark.parametrize("frequency", [100.0, 5e3])
def test_backward_mirrors_forward(ratio: float, frequency: float) -> None:
    """alpha takes |z|: the mirrored drive gives the mirrored motion, whatever z_ba / z_ss is."""
    values = {"z_ba": 18e-9, "z_ss": 18e-9 / ratio, "frequency": frequency}
    runs = []
    for sign in (1, -1):
        simulation, drive_cycle = simulation_of(values, sign)
        simulation.start(drive_cycle, 15)
        runs.append(simulation.run_cycles(15))
    assert runs[0].position[-1] > 100e-9
    np.testing.assert_array_equal(runs[1].position, -runs[0].position)
    np.testing.assert_array_equal(runs[1].z_min, -runs[0].z_max)
    np.testing.assert_allclose(runs[1].backstep, runs[0].backstep, rtol=1e-12)
    np.testing.assert_allclose(runs[1].lost, runs[0].lost, rtol=1e-9)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("replay", [True, False])
def test_sampling_leaves_the_path_alone(law: str, replay: bool) -> None:
    """Sampled often, seldom or never: the same states to the last bit."""
    values = {"model": law, "frequency": 3e3, "amplitude": 250.0}
    whole, drive_cycle = simulation_of(values, replay=replay)
    whole.start(drive_cycle, 40)
    whole.advance(40 * drive_cycle.period)
    often, _ = simulation_of(values, replay=replay)
    often.start(drive_cycle, 40)
    times = np.append(np.sort(np.random.default_rng(3).uniform(0, 40, 900)), 40.0)
    states = states_at(often, times * drive_cycle.period)
    assert states[-1] == whole.state
    seldom, _ = simulation_of(values, replay=replay)
    seldom.start(drive_cycle, 40)
    assert states_at(seldom, times[::7] * drive_cycle.period) == states[::7]


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("frequency", [100.0, 1e3, 1e4])
def test_replay_agrees_with_solving(law: str, frequency: float) -> None:
    """Cycles that begin alike may be repeated unsolved: the difference is below the tolerance."""
    values = {"model": law, "frequency": frequency}
    runs = []
    for replay in (True, False):
        simulation, drive_cycle = simulation_of(values, replay=replay)
        simulation.start(drive_cycle, 500)
        runs.append(simulation.run_cycles(500))
    drift = np.abs(runs[0].position - runs[1].position)
    assert (drift <= 2e-12 * (1 + np.arange(500))).all()
    np.testing.assert_allclose(runs[0].lost, runs[1].lost, rtol=1e-6)
    np.testing.assert_allclose(runs[0].backstep[1:], runs[1].backstep[1:], atol=1e-11)


def test_replay_ends_with_a_new_command() -> None:
    """After a repeated stretch another drive is solved from where the first one ended."""
    ends = []
    for replay in (True, False):
        simulation, drive_cycle = simulation_of({}, replay=replay)
        simulation.start(drive_cycle, 200)
        simulation.run_cycles(200)
        simulation.start(sawtooth(200.0, 400.0, 100.0, table_1().actuator.gain, -1), 50)
        simulation.run_cycles(50)
        ends.append(simulation.state.x)
    assert ends[0] == pytest.approx(ends[1], abs=250 * 2e-12)


@pytest.mark.parametrize("law", LAWS)
def test_energy_balance(law: str) -> None:
    """Work of actuator and load goes into motion, springs and heat; heat never comes back."""
    p = table_1(**{"model": law, "frequency": 2e3, "force": 0.03, "spring": 2e4})
    plant, drive_cycle = Plant.of(p), drive_of(p)
    simulation = Simulation(plant, p.solver.tolerance, replay=False)
    simulation.start(drive_cycle, 6)
    kinks = np.append(0.0, np.cumsum(np.tile(drive_cycle.durations, 6)))
    heat = heat_of(simulation, kinks.tolist())
    again = Simulation(plant, p.solver.tolerance, replay=False)
    again.start(drive_cycle, 6)
    lost = again.run_cycles(6).lost
    assert (lost > 0.0).all()
    assert lost.sum() == pytest.approx(heat, rel=2e-3)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("load", [0.0, 0.05])
def test_contact_never_creates_energy(law: str, load: float) -> None:
    """Power turned into heat, F w - sigma_0 z z', is never negative along a run."""
    simulation, drive_cycle = simulation_of({"frequency": 1e3, "model": law, "force": load})
    simulation.start(drive_cycle, 3)
    contact = simulation.plant.contact
    slips = drive_cycle.durations[0] + drive_cycle.period * np.arange(3)
    kinks = np.add.outer(slips, np.linspace(0, 4e-6, 400)).ravel()
    times = np.unique(np.concatenate([np.linspace(0, 3 * drive_cycle.period, 5000), kinks]))
    seen = simulation.sample(times)
    for z, w, force in zip(seen.z, seen.v - seen.rate, seen.force, strict=True):
        assert force * w - contact.sigma_0 * z * z_rate(z, w, contact) >= -1e-15


drives = some.fixed_dictionaries(
    {
        "model": some.sampled_from(LAWS),
        "preload": some.floats(0.1, 6.0),
        "mass": some.floats(1e-3, 20e-3),
        "sigma_1": some.floats(0.5, 500.0),
        "sigma_2": some.sampled_from([0.0, 0.5]),
        "frequency": some.floats(50.0, 50e3),
        "amplitude": some.floats(1.0, 300.0),
        "slewrate": some.floats(50.0, 1000.0),
        "force": some.floats(-0.02, 0.02) | some.just(0.0),
        "spring": some.floats(0.0, 1e6) | some.floats(0.0, 1.0),
    }
)


@pytest.mark.long
@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(values=drives, cut=some.floats(0.01, 7.99))
def test_any_drive_and_load(values: dict[str, Any], cut: float) -> None:
    """No heat is negative, |z| stays bounded, mirrored is mirrored, cutting changes nothing."""
    try:
        simulation, drive_cycle = simulation_of(values)
    except ParameterError:  # the slip does not fit into the period
        return
    simulation.start(drive_cycle, 8)
    cycles = simulation.run_cycles(8)
    assert np.isfinite(cycles.position).all()
    contact = simulation.plant.contact
    assert (cycles.lost > -1e-9 * contact.sigma_0 * max(contact.z_ss, contact.z_k) ** 2).all()
    bound = max(contact.z_ss, contact.z_k, contact.z_s, contact.z_ba)
    ringing = abs(values["force"]) / contact.sigma_0
    assert max(cycles.z_max.max(), -cycles.z_min.min()) <= bound + 2 * ringing + 1e-15
    mirrored, back = simulation_of({**values, "force": -values["force"]}, -1)
    mirrored.start(back, 8)
    np.testing.assert_array_equal(mirrored.run_cycles(8).position, -cycles.position)
    later, _ = simulation_of({**values, "force": 0.0})
    early, _ = simulation_of({**values, "force": 0.0})
    later.advance(cut)
    for shifted in (early, later):
        shifted.start(drive_cycle, 8)
    np.testing.assert_array_equal(later.run_cycles(8).position, early.run_cycles(8).position)
    parts, _ = simulation_of(values)
    parts.start(drive_cycle, 8)
    parts.advance(cut * drive_cycle.period)
    parts.advance(8 * drive_cycle.period)
    whole, _ = simulation_of(values)
    whole.start(drive_cycle, 8)
    whole.advance(8 * drive_cycle.period)
    assert parts.state == whole.state


@pytest.mark.parametrize("offset", [-1e-13, -1e-16, 0.0, 1e-16, 1e-13])
def test_grazing_peaks(offset: float) -> None:
    """Ringing whose peak just touches z_ba ends neither in a hang nor in a jump."""
    p = table_1(sigma_1=0.0)
    plant = Plant.of(p)
    omega = np.sqrt(plant.contact.sigma_0 / plant.mass)
    rate = (
        plant.contact.z_ba + offset
    ) * omega  # the peak of |z| after a sudden start is rate/omega
    simulation = Simulation(plant, p.solver.tolerance)
    simulation.start(DriveCycle(np.array([2e-3, 1e-3]), np.array([rate, 0.0]), slip=-1, sign=1), 1)
    cycles = simulation.run_cycles(1)
    assert np.isfinite(cycles.position).all()
    assert cycles.z_min.min() == pytest.approx(-plant.contact.z_ba, abs=2e-9)


@pytest.mark.parametrize("load", [0.0, 0.1, 0.1619, 0.162, 0.17, 0.2, 5.0])
def test_standing_under_load(load: float) -> None:
    """A load below breakaway holds, above it the runner slides: sigma_0 z_ba is 0.162 N here."""
    p = table_1(force=load)
    simulation = Simulation(Plant.of(p), p.solver.tolerance)
    simulation.advance(0.5)
    resting = simulation.state.x
    simulation.advance(1.0)
    moved = simulation.state.x - resting
    if load <= 0.1619:
        assert moved == pytest.approx(0.0, abs=1e-15)
        assert simulation.state.z == pytest.approx(load / 9e6, rel=1e-9)
    if load <= 0.2:  # below sigma_0 z of steady sliding, 0.224 N, it comes to rest, if slowly
        assert abs(moved) < 1e-9
    else:
        assert moved > 1e-3


def test_time_runs_forward_only() -> None:
    """Going back is refused and names both times."""
    simulation, _ = simulation_of({})
    simulation.advance(1.0)
    with pytest.raises(ValueError, match=r"1\.0 s to 0\.5 s"):
        simulation.advance(0.5)
    with pytest.raises(ValueError, match="1 cycles asked for, 0 are left"):
        simulation.run_cycles(1)


@pytest.mark.parametrize("contacts", [{}, UNEQUAL])
def test_samples_are_the_states_at_their_times(contacts: dict[str, Any]) -> None:
    values = {"frequency": 1000.0, **contacts}
    (one, drive_cycle), (other, _) = (simulation_of(values) for _ in range(2))
    for simulation in (one, other):
        simulation.start(drive_cycle, 38)
    times = np.linspace(0.0, 40e-3, 2401)
    samples = one.sample(times)
    for k, t in enumerate(times):
        other.advance(float(t))
        now = other.state
        found = samples.x[k], samples.v[k], samples.z[k], samples.rate[k], samples.u[k]
        assert found == (now.x, now.v, now.z, now.rate, now.u)
        assert samples.force[k] == now.force
        assert (samples.each[:, k] == other.deflections).all()
    assert one.state == other.state


@pytest.mark.parametrize("times", [[1e-3, 0.5e-3], [-1e-3, 0.0], [0.0, math.nan]])
def test_times_of_samples_do_not_fall(times: list[float]) -> None:
    simulation, _ = simulation_of({})
    with pytest.raises(ValueError, match="must not fall"):
        simulation.sample(np.array(times))


P = table_1(frequency=1e3)
CYCLE = drive_of(P)
BACK = drive_of(P, -1)


def new() -> Simulation:
    return Simulation(Plant.of(P), P.solver.tolerance)


@pytest.mark.parametrize("distance", [80e-9, -80e-9, 0.0])
def test_a_ramp_is_one_segment_without_a_slip(distance: float) -> None:
    drive_cycle = ramp(distance, 0.02)
    assert len(drive_cycle.durations) == 1
    assert drive_cycle.shift == pytest.approx(distance, rel=1e-15)
    assert (drive_cycle.period, drive_cycle.slip) == (0.02, -1)
    assert drive_cycle.sign == (-1 if distance < 0.0 else 1)


@pytest.mark.parametrize("duration", [0.0, -1.0, np.inf, np.nan])
def test_a_ramp_takes_time(duration: float) -> None:
    with pytest.raises(ParameterError, match=f"duration of a ramp is {duration:g} s"):
        ramp(1e-9, duration)


def test_a_closed_drive_cycle_shifts_nothing() -> None:
    assert CYCLE.shift == 0.0
    assert DriveCycle(np.array([1e-3, 2e-3]), np.array([3e-5, -1e-5]), 1, 1).shift == pytest.approx(
        1e-8
    )


def test_open_drive_cycles_run_once() -> None:
    simulation = new()
    with pytest.raises(ValueError, match=r"2 times a drive cycle that ends 1e-08 m from where"):
        simulation.start(ramp(1e-8, 1.0), 2)
    simulation.start(CYCLE, 3)  # what was refused has left nothing behind
    simulation.run_cycles(3)
    assert simulation.state.u == 0.0


def test_a_scan_carries_the_runner_and_holds_the_level() -> None:
    """Slow enough not to slip: the runner goes along with u, and u stays where it was led."""
    simulation = new()
    simulation.start(ramp(90e-9, 0.1), 1)
    simulation.advance(0.05)
    assert simulation.state.u == pytest.approx(45e-9, rel=1e-12)
    simulation.advance(0.3)
    state = simulation.state
    assert state.u == pytest.approx(90e-9, rel=1e-12)
    assert state.rate == 0.0
    assert state.x == pytest.approx(90e-9, abs=1e-15)
    assert (simulation.cycles_done, simulation.cycles_left) == (1, 0)
    assert np.isnan(simulation.backstep)
    assert not simulation.stepping_back


@pytest.mark.parametrize("replay", [True, False])
def test_u_is_continuous_over_patterns_and_rests(replay: bool) -> None:
    """Cut short, led elsewhere, resting: u never jumps, and u' is what it rises by."""
    simulation = Simulation(Plant.of(P), P.solver.tolerance, replay)
    commands = [
        (0.0, CYCLE, 7),
        (4.3e-3, ramp(50e-9, 2e-3), 1),
        (5.1e-3, ramp(-70e-9, 1e-3), 1),  # redirected half-way
        (7.5e-3, BACK, 3),
        (9.9994e-3, CYCLE, 2),
    ]
    t, dt, before = 0.0, 0.7e-6, simulation.state
    while t < 14e-3:
        if commands and commands[0][0] <= t:
            _, drive_cycle, count = commands.pop(0)
            simulation.start(drive_cycle, count)
            assert simulation.state.u == before.u
        t += dt
        simulation.advance(t)
        now = simulation.state
        assert abs(now.u - before.u) <= 53.4e-3 * dt
        before = now
    assert not commands


def test_closed_patterns_bring_u_back_exactly() -> None:
    """However many cycles, at their ends u is exactly where they began."""
    simulation = new()
    simulation.start(ramp(33.3e-9, 1e-3), 1)
    simulation.advance(2e-3)
    level = simulation.state.u
    for drive_cycle, count in ((CYCLE, 1001), (BACK, 777)):
        simulation.start(drive_cycle, count)
        for part in (1, count // 2, count - 1 - count // 2):
            simulation.run_cycles(part)
            assert simulation.state.u == level
    simulation.advance(simulation.state.t + 1.0)
    assert simulation.state.u == level


def test_a_drive_cycle_in_the_middle_of_another_begins_where_that_one_was() -> None:
    """Position, velocity and deflection go on; the general integrator finds the same way."""
    scan, back = ramp(100e-9, 1e-3), ramp(-60e-9, 0.5e-3)
    simulation = new()
    simulation.start(scan, 1)
    simulation.advance(0.35e-3)
    before = simulation.state
    simulation.start(back, 1)
    assert simulation.state == before
    simulation.advance(0.85e-3)
    assert simulation.state.u == pytest.approx(-25e-9, abs=1e-20)
    kinked = DriveCycle(np.array([0.35e-3, 0.5e-3]), np.append(scan.rates, back.rates), -1, 1)
    expected = follow(P, kinked, [0.85e-3])[0]
    assert simulation.state.x == pytest.approx(expected, abs=1e-12)
