# SPDX-License-Identifier: Apache-2.0
"""The solver against numbers of others, a general integrator and exact solutions."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.polynomial.chebyshev import chebval
from numpy.typing import NDArray
from reference import integrate, z_rate_and_force
from scipy.integrate import solve_ivp
from table_1 import table_1

from stickslip_ros.physics.model import DriveCycle, Plant, drive_of, sawtooth
from stickslip_ros.physics.parameters import Parameters
from stickslip_ros.physics.solver import Simulation
from stickslip_ros.physics.solver.layout import PLANT, open_record

NANO = 1e9


def positions(cycles: int, tolerance: float | None = None, **values: Any) -> NDArray[np.float64]:
    """Return x (m) at the end of each cycle from rest."""
    p = table_1(**values)
    simulation = Simulation(Plant.of(p), tolerance or p.solver.tolerance, replay=False)
    simulation.start(drive_of(p), cycles)
    return simulation.run_cycles(cycles).position


def test_position_after_many_cycles() -> None:
    """Numbers of an independent Runge-Kutta of fixed step, 1e-7 s in stick and 1e-9 s in slip."""
    assert NANO * positions(20)[-1] == pytest.approx(2702.455, abs=0.02)
    assert NANO * positions(200, frequency=1e3)[-1] == pytest.approx(24536.587, abs=0.02)


@pytest.mark.parametrize(
    "values",
    [
        {"frequency": 1e4},
        {"frequency": 5e3, "force": 0.05},
        {"frequency": 5e3, "force": -0.15},
        {"frequency": 1e4, "spring": 1e6, "preload": 1.0},
        {"frequency": 2e4, "sigma_1": 800.0},
        {"frequency": 1e4, "sigma_2": 3.0},
        {"frequency": 1e4, "mu": 1.5},
        {"frequency": 18.5e3, "amplitude": 100.0},
        {"frequency": 1e5, "preload": 1.0},
        {"frequency": 1e4, "inclination": 1.2, "payload": 2e-3},
        {"frequency": 1e4, "model": "lugre"},
        {"frequency": 1e4, "model": "lugre", "sigma_2": 1.0, "force": 0.02},
        {"frequency": 1e4, "model": "epm_fix", "spring": 1e5},
        {"frequency": 1e4, "model": "epm_calc", "preload": 1.0},
        {"frequency": 1e4, "model": "epm_calc", "preload": 0.7, "amplitude": 200.0},
        {"frequency": 1e4, "model": "epm_calc", "preload": 1.0, "mu_s": 0.2, "mu_k": 0.2},
    ],
    ids=lambda values: ",".join(f"{k}={v}" for k, v in values.items()),
)
def test_general_integrator_agrees(values: dict[str, Any]) -> None:
    """Every law, load and damping: within a thousandth of a nanometre per cycle."""
    p = table_1(**values)
    agree(p, drive_of(p), 4)


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
def test_every_waveform_and_hysteresis(values: dict[str, Any], sign: int, tmp_path: Path) -> None:
    """Within a thousandth of a nanometre per cycle; the actuator is back where it began."""
    table = tmp_path / "smooth.csv"
    t = np.linspace(0.0, 1.0, 33)
    levels = np.append(0.5 - 0.5 * np.cos(np.pi * t[:-1] ** 2), 0.0)
    table.write_text("\n".join(map(repr, levels.tolist())))
    p = table_1(**{"frequency": 1e4, "waveform_table": str(table), **values})
    agree(p, drive_of(p, sign), 4)


def agree(p: Parameters, drive_cycle: DriveCycle, cycles: int) -> None:
    """Assert that the kernel agrees with a general integrator, and brings the actuator back."""
    simulation = Simulation(Plant.of(p), 2e-12)
    simulation.start(drive_cycle, cycles)
    found = simulation.run_cycles(cycles).position
    assert np.abs(found - integrate(p, drive_cycle, cycles)).max() < cycles * 1e-12
    assert simulation.state.u == pytest.approx(0.0, abs=1e-20)


@pytest.mark.parametrize("frequency", [40e3, 10e3])
def test_any_piecewise_linear_drive_cycle(frequency: float) -> None:
    """A triangle with a hold and a slip in two parts run as well as a sawtooth."""
    part = 1.0 / frequency / 10.0
    drive_cycle = DriveCycle(
        durations=np.array([4 * part, part, 1e-6, 2 * part, 0.5e-6, 3 * part - 1.5e-6]),
        rates=np.array([140e-9 / (4 * part), 0.0, -90e-3, 0.0, -100e-3, 0.0]),
        slip=2,
        sign=1,
    )
    agree(table_1(), drive_cycle, 5)


@pytest.mark.parametrize("sigma_1", [0.0, 5.0, 200.0, 2.0 * math.sqrt(9e6 * 4e-3), 3000.0])
def test_elastic_regime_is_the_exact_oscillator(sigma_1: float) -> None:
    """Below breakaway the runner follows a ramp as a damped oscillator, known in closed form."""
    plant = Plant.of(table_1(sigma_1=sigma_1))
    rate, t = 2e-5, 3e-4
    simulation = Simulation(plant, 2e-12)
    simulation.start(DriveCycle(np.array([1e-2]), np.array([rate]), slip=-1, sign=1), 1)
    m, k = plant.mass, plant.contact.sigma_0
    delta = sigma_1 / (2.0 * m)
    root = np.sqrt(complex(delta**2 - k / m))
    for moment in (1e-9, 1e-5, 1e-4, t):
        simulation.advance(moment)
        if abs(root) < 1e-3 * delta:
            z = -rate * moment * math.exp(-delta * moment)
        else:
            z = (-rate * np.exp(-delta * moment) * np.sinh(root * moment) / root).real
        state = simulation.state
        assert state.z == pytest.approx(z, abs=1e-20, rel=1e-9)
        assert state.x == pytest.approx(rate * moment + z, abs=1e-20, rel=1e-9)


@pytest.mark.parametrize(("preload", "mass"), [(0.4, 4e-3), (1.0, 3e-3)])
@pytest.mark.parametrize("frequency", [100.0, 1e3, 18.5e3])
def test_error_follows_the_tolerance(preload: float, mass: float, frequency: float) -> None:
    """Over six decades: never above the tolerance per cycle, and falling with it.

    Arcs known ahead are far better than asked for at coarse tolerances, so the error does not fall
    step by step; fitted over all decades it falls about as the tolerance does.
    """
    values = {"preload": preload, "mass": mass, "frequency": frequency}
    exact = positions(30, tolerance=1e-17, **values)
    tolerances = 10.0 ** np.arange(-9, -15, -1.0)
    errors = np.array(
        [
            np.abs(np.diff(positions(30, tolerance=float(t), **values) - exact, prepend=0.0)).max()
            for t in tolerances
        ]
    )
    assert (errors <= tolerances).all(), errors
    order = np.polyfit(np.log(tolerances), np.log(np.maximum(errors, 1e-18)), 1)[0]
    assert 0.4 < order < 1.6, (order, errors)


def random_sets(count: int) -> list[tuple[Parameters, DriveCycle]]:
    """Return operating points from all over the range of real drives."""
    rng = np.random.default_rng(20111)
    sets: list[tuple[Parameters, DriveCycle]] = []
    while len(sets) < count:
        p = table_1(
            mass=rng.uniform(3e-3, 15e-3),
            preload=rng.uniform(0.1, 5.0),
            sigma_1=rng.uniform(3.0, 60.0),
        )
        frequency = 10 ** rng.uniform(math.log10(30.0), math.log10(20e3))
        slewrate = 10 ** rng.uniform(math.log10(50.0), 3.0)
        amplitude = rng.uniform(10.0, 300.0)
        if amplitude / slewrate * 1e-6 < 0.95 / frequency:
            drive_cycle = sawtooth(amplitude, frequency, slewrate, p.actuator.gain)
            sets.append((p, drive_cycle))
    return sets


@pytest.mark.parametrize("count", [15, pytest.param(200, marks=pytest.mark.long)])
def test_random_sets(count: int) -> None:
    """At a tolerance of 1e-11 m no cycle is off by more than a thousandth of a nanometre.

    Held against the integrator of the whole system, which shares nothing with the kernel, over
    three cycles from rest, and against the kernel at its finest, cycle by cycle over twenty.
    """
    for p, drive_cycle in random_sets(count):
        plant, runs = Plant.of(p), []
        for limit in (1e-11, 1e-16):
            simulation = Simulation(plant, limit, replay=False)
            simulation.start(drive_cycle, 20)
            runs.append(simulation.run_cycles(20).position)
        error = np.abs(np.diff(runs[0] - runs[1], prepend=0.0)).max()
        assert error < 1e-12, (plant, drive_cycle, error)
        error = abs(runs[0][2] - integrate(p, drive_cycle, 3)[-1]) / 3
        assert error < 1e-12, (plant, drive_cycle, error)


TOLERANCE = 1e-12  # m


def _turn(plant: Plant, z: float) -> tuple[float, float, float]:
    """Return z (m) at the next turn after one at z, the time (s) and the path (m) until then."""

    def rate(_: float, y: np.ndarray) -> list[float]:
        z_rate, force = z_rate_and_force(y[0], y[1], plant.contact)
        return [z_rate, (plant.force - force) / plant.mass, y[1]]

    def turns(t: float, y: np.ndarray) -> float:
        return float(y[1]) if t > 1e-7 else plant.force - plant.contact.sigma_0 * z

    turns.terminal = True  # type: ignore[attr-defined]
    found = solve_ivp(
        rate, (0.0, 1.0), [z, 0.0, 0.0], "DOP853", events=turns, rtol=1e-11, atol=1e-18
    )
    return float(found.y[0, -1]), float(found.t[-1]), float(found.y[2, -1])


@pytest.mark.parametrize("force", [0.0, 0.01])
@pytest.mark.parametrize("side", [0, 1])
def test_swings_of_a_plastic_contact_are_those_of_an_integrator(side: int, force: float) -> None:
    """From one turn to the next: where it turns, when, and the way there, over the whole table."""
    p = table_1(model="lugre", force=force)
    plant = Plant.of(p)
    simulation = Simulation(plant, TOLERANCE)
    simulation.start(drive_of(p, 1), 1)
    simulation.run_cycles(1)  # which fills the tables
    tables = open_record(simulation._plant, PLANT)
    rest, top = force / plant.contact.sigma_0, float(tables["swing_top"][side])
    assert top > 1e-9
    sign = 1.0 if side == 0 else -1.0
    for share in (0.03, 0.31, 0.62, 0.97):
        # parts of the distance from rest that are left and gone, and the time in between
        left, time, gone = chebval(2.0 * share - 1.0, tables["swing"][side].T)
        z, t, path = _turn(plant, rest + sign * share * top)
        assert left * share * top == pytest.approx(abs(z - rest), abs=10 * TOLERANCE)
        assert time == pytest.approx(t, rel=1e-4)
        assert abs(gone) * share * top == pytest.approx(abs(path), abs=10 * TOLERANCE)
