# SPDX-License-Identifier: Apache-2.0
"""Steps that vary: along the way, from cycle to cycle, with dwell and rate."""

import math
import os
from typing import Any

import numpy as np
import pytest
from table_1 import table_1

from stickslip_ros.physics.model import Plant, drive_of
from stickslip_ros.physics.model.surface import CycleStart, Surface
from stickslip_ros.physics.model.waveforms import command_of
from stickslip_ros.physics.parameters import Parameters
from stickslip_ros.physics.solver import Simulation
from stickslip_ros.physics.solver.driven import DrivenSimulation, simulation_of
from stickslip_ros.simulation.operating_points import steps_of, zero_amplitudes
from stickslip_ros.simulation.steps import run_steps
from validation.whole_system import aged, positions

ROUGH = {"surface_spread": 0.2, "surface_length": 1e-6}


def _steps(count: int, **values: Any) -> np.ndarray:
    p = table_1(**values)
    simulation = simulation_of(p, Plant.of(p))
    simulation.start(drive_of(p), count)
    return np.diff(simulation.run_cycles(count).position)


def _surface(**values: Any) -> Surface:
    surface = Surface.of(table_1(**values).friction)
    assert surface is not None
    return surface


def test_the_field_has_its_spread_and_correlation_length() -> None:
    surface = _surface(**ROUGH, surface_seed=3)
    x = np.arange(0.0, 600e-6, 0.25e-6)
    logarithm = np.log([surface.factor(CycleStart(at, 0)) for at in x])
    assert logarithm.std() == pytest.approx(0.2, rel=0.1)
    assert abs(logarithm.mean()) < 0.04
    for lag in (2, 4, 6):  # quarters of a correlation length
        correlation = np.corrcoef(logarithm[lag:], logarithm[:-lag])[0, 1]
        assert correlation == pytest.approx(np.exp(-((0.25 * lag) ** 2)), abs=0.08)
    assert surface.factor(CycleStart(123e-6, 0)) == surface.factor(CycleStart(123e-6, 7))


def test_cycles_differ_by_their_number_only() -> None:
    surface = _surface(slip_spread=0.1)
    logarithm = np.log([surface.factor(CycleStart(0.0, k)) for k in range(4000)])
    assert logarithm.std() == pytest.approx(0.1, rel=0.05)
    assert abs(np.corrcoef(logarithm[1:], logarithm[:-1])[0, 1]) < 0.05
    assert surface.factor(CycleStart(0.0, 5)) == surface.factor(CycleStart(1e-3, 5))


def test_wear_ends_at_a_hundredth_and_a_hundredfold_however_far_a_runner_is_carried() -> None:
    for rate, most in ((1e4, 0.01), (-1e4, 100.0)):
        surface = _surface(wear_rate=rate)
        found = [surface.factor(CycleStart(0.0, 0, slid=slid)) for slid in (1e-5, 1.0, 1e9)]
        assert found == [math.exp(-rate * 1e-5), most, most]


def test_steps_scatter_and_a_run_repeats_to_the_bit() -> None:
    values = {**ROUGH, "slip_spread": 0.1, "surface_seed": 5}
    steps = _steps(60, **values)
    plain = _steps(60)
    assert 0.5e-9 < steps[7:].std() < 20e-9
    assert plain[7:].std() < 1e-12
    # 7 correlation lengths: the mean of the spread is 0.2 / sqrt(7), that of the step less
    assert steps[7:].mean() == pytest.approx(plain[7:].mean(), rel=0.15)
    assert (steps == _steps(60, **values)).all()
    assert (steps != _steps(60, **{**values, "surface_seed": 6})).any()


def test_the_way_back_meets_the_same_surface() -> None:
    """A symmetric drive back and forth: contacts at equal places are equal."""
    p = table_1(**ROUGH, surface_seed=4)
    simulation = simulation_of(p, Plant.of(p))
    found = []
    for sign in (1, -1):
        for _ in range(12):
            simulation.start(drive_of(p, sign), 1)
            found.append((simulation.x, simulation.plant.contact.z_ba))
            simulation.run_cycles(1)
    x, z_ba = np.array(found).T
    surface = _surface(**ROUGH, surface_seed=4)
    nominal = Plant.of(p).contact.z_ba
    assert z_ba == pytest.approx(
        [nominal * surface.factor(CycleStart(float(at), 0)) for at in x], rel=1e-12
    )
    assert np.ptp(z_ba) > 0.05 * nominal


def test_without_a_spread_there_is_the_plain_simulation_and_with_a_small_one_nearly() -> None:
    p = table_1()
    assert type(simulation_of(p, Plant.of(p))) is Simulation
    assert _steps(12, surface_spread=1e-9) == pytest.approx(_steps(12), abs=1e-13)


AGEING: dict[str, Any] = {"dwell_growth": 0.06, "dwell_start": 1e-5, "rate_growth": -0.02}


#: Ranges from which random drives take what varies; "log" is of the decadic logarithm
DWELL = {
    "dwell_growth": (0.02, 0.15),
    "log dwell_start": (-6.0, -4.0),
    "rate_growth": (-0.03, 0.05),
}
SPREADS = {"surface_spread": (0.02, 0.3), "log surface_length": (-7.0, -6.0),
           "slip_spread": (0.01, 0.1), "surface_seed": (1, 10**6)}  # fmt: skip
ACTUATOR = {"log actuator_resonance": (5.0, 6.0), "actuator_damping": (0.1, 0.6),
            "log amplifier_bandwidth": (5.0, 6.3), "creep": (0.005, 0.03)}  # fmt: skip
WORN = {"wear_rate": (-1e4, 1e4), "temperature": (2.0, 400.0), "gain_temperature": (-1e-3, 3e-3),
        "friction_temperature": (-1e-3, 3e-3)}  # fmt: skip
VARIED = {
    "dwell and rate": DWELL,
    "spreads": SPREADS,
    "wear and temperature": WORN,
    "everything": {
        **DWELL,
        **SPREADS,
        **WORN,
        **ACTUATOR,
        "hysteresis": (0.05, 0.2),
        "contacts": (2, 5),
    },
}


def _random(name: str, seed: int) -> Parameters:
    random = np.random.default_rng([seed, len(name)])
    ranges = {"frequency": (5e3, 1.2e4), "preload": (0.3, 1.5), "slewrate": (80.0, 300.0)}
    values: dict[str, Any] = {}
    for key, bounds in {**ranges, **VARIED[name]}.items():
        value = float(random.uniform(*bounds))
        values[key.removeprefix("log ")] = 10.0**value if key.startswith("log ") else value
    if "surface_seed" in values:
        values |= {"surface_seed": int(values["surface_seed"])}
    if "hysteresis" in values:
        values |= {"actuator": "hysteresis", "actuator_memory": True}
        values |= {"contacts": int(values["contacts"]), "contact_spread": 0.2}
    return table_1(**values)


def _agrees(p: Parameters) -> None:
    """To 0.01 nm a cycle: a rest makes the next slip start from a stronger contact."""
    rest = 3e-4
    simulation = simulation_of(p, Plant.of(p))
    found: list[float] = []
    for _ in range(2):
        simulation.start(command_of(p), 2)
        found += simulation.run_cycles(2).position.tolist()
        simulation.advance(simulation.t + rest)
    expected = positions(p, 2, rest, again=2)
    off = np.abs(np.array(found) - expected[[0, 1, 3, 4]]) / np.arange(1, 5)
    print(f"off by {1e12 * off.max():.2f} pm a cycle")
    assert off.max() < 1e-11


def test_random_runs_with_rests_agree_with_an_integrator() -> None:
    for name, seed in [
        *(("dwell and rate", seed) for seed in range(2)),
        *(("wear and temperature", seed) for seed in range(3)),
        *(("spreads", 0), ("everything", 0)),
    ]:
        _agrees(_random(name, seed))


@pytest.mark.long
@pytest.mark.parametrize("name", VARIED)
@pytest.mark.parametrize("seed", range(100, 100 + int(os.environ.get("STICKSLIP_DRIVES", "1"))))
def test_more_random_runs_with_rests_agree_with_an_integrator(name: str, seed: int) -> None:
    """STICKSLIP_DRIVES=20 runs 20 of each."""
    _agrees(_random(name, seed))


def test_the_contact_of_each_cycle_is_that_of_its_dwell_and_rate() -> None:
    p = table_1(**AGEING, frequency=1e3)
    cycle = drive_of(p)
    simulation = simulation_of(p, Plant.of(p))
    rate, begins = abs(float(cycle.rates[1])), float(cycle.durations[0])

    def z_ba(dwell: float) -> float:
        return aged(p, dwell, rate).contact.z_ba

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


def test_the_rate_behind_a_loop_is_that_of_the_command() -> None:
    """It was that of the deflection, 0.17 nm a step off."""
    p = Parameters.of(
        preload=1.0, mass=0.006, sigma_1=40.0, amplitude=200.0, frequency=300.0, slewrate=300.0,
        rate_growth=0.3, rate_start=0.4, actuator="hysteresis", hysteresis=0.15,
    )  # fmt: skip
    expected = np.diff(positions(p.replace(actuator_memory=True), 12))[-1]
    assert np.diff(run_steps(p, 12).position)[-1] == pytest.approx(expected, abs=1e-12)


def test_a_slip_too_short_for_the_clock_ends_the_dwell() -> None:
    """A runner that creeps under its load: nothing but the dwell is not as behind a longer slip."""
    values = {"model": "lugre", "preload": 732.0, "mu_s": 0.137, "sigma_0_cap": 138.0, "mass": 1.08}
    values |= {"sigma_1": 1.9, "force": 3.76, "amplitude": 7e-8, "frequency": 1.509}
    ends = []
    for slewrate in (0.02, 2e5):  # V/us: 4e-12 and 4e-19 s
        p = Parameters.of({**values, "dwell_growth": 0.04, "slewrate": slewrate})
        simulation = simulation_of(p, Plant.of(p))
        simulation.start(command_of(p), 3)
        ends.append(simulation.run_cycles(3).position)
    np.testing.assert_allclose(ends[0], ends[1], rtol=1e-9)


def test_temperature_is_another_gain_and_another_breakaway() -> None:
    """To the bit; without a coefficient it changes nothing."""
    cold: dict[str, Any] = {"temperature": 77.0, "amplitude": 200.0}
    plain, still = (run_steps(table_1(**values), 5) for values in ({"amplitude": 200.0}, cold))
    assert (still.position == plain.position).all()
    shrunk = table_1(**cold, gain_temperature=3e-3)
    gain = shrunk.actuator.gain * (1.0 + 3e-3 * (77.0 - 293.15))
    expected = run_steps(table_1(amplitude=200.0, gain=gain), 5).position
    assert (run_steps(shrunk, 5).position == expected).all()
    weak, contact = Plant.of(table_1(friction_temperature=2e-3, **cold)), Plant.of(table_1())
    for name in ("z_ba", "z_ss", "z_k", "z_s"):
        left = getattr(weak.contact, name) / getattr(contact.contact, name)
        assert left == pytest.approx(1.0 - 2e-3 * 216.15, rel=1e-12)
    assert weak.contact.sigma_0 == contact.contact.sigma_0


def test_the_contact_wears_with_the_way_that_it_slides() -> None:
    """By what samples of w and z say of that way, and no farther than a hundredth."""
    p = table_1(wear_rate=1e4, frequency=1e3)
    simulation, times = simulation_of(p, Plant.of(p), replay=False), np.linspace(0.0, 5e-3, 200_001)
    simulation.start(command_of(p), 6)
    samples = simulation.sample(times)
    slid = np.abs(np.diff(samples.x - samples.u - samples.z)).sum()
    fresh = Plant.of(p).contact.z_ba
    assert simulation.plant.contact.z_ba == pytest.approx(fresh * np.exp(-1e4 * slid), rel=1e-5)
    assert 1e4 * slid > 5e-3
    simulation.start(command_of(p), 4000)
    simulation.run_cycles(4000)
    assert simulation.plant.contact.z_ba == pytest.approx(0.01 * fresh, rel=1e-12)


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
