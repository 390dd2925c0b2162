# SPDX-License-Identifier: Apache-2.0
"""Corners of the ranges in which the solver was once wrong or slow, found by the campaign."""

import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad

from stickslip_ros.model import Plant, drive_of
from stickslip_ros.parameters import ParameterError, Parameters
from stickslip_ros.solver import Simulation
from validation.benchmark import judge

#: Error allowed per cycle, m
BAR = 1e-11

#: The load carries the runner off: what its speed is off by stays with it.
CARRIED_OFF: dict[str, dict[str, Any]] = {
    "damping of 1e6 N s/m": {
        **{"model": "lugre", "preload": 0.0506, "mu_s": 0.22, "mu_k": 0.702, "v_stribeck": 4.18e-5},
        **{"sigma_1": 1e6, "mass": 2.44e-4, "force": -100.0, "slewrate": 11633.0},
        **{"amplitude": 131.0, "frequency": 2486.0},
    },
    "one that begins after cycles": {
        **{"model": "ceim_without_mu", "preload": 8.43, "sigma_0": 168472.0, "sigma_0ss": 1.339e7},
        **{"sigma_1": 1e6, "z_ba": 3.757e-7, "mass": 6.902e-4, "force": 600.0, "slewrate": 90.5},
        **{"amplitude": 70.74, "frequency": 5333.7, "waveform": "triangle"},
    },
    "a wide Stribeck curve": {
        **{"model": "epm_fix", "preload": 0.2, "mu_s": 0.0866, "mu_k": 0.147, "v_stribeck": 3.46},
        **{"sigma_0": 5.03e5, "sigma_1": 81.6, "z_ba": 1.25e-9, "mass": 2.02e-6, "force": -0.05},
        **{"slewrate": 15.56, "amplitude": 11.0, "frequency": 22.76, "waveform": "triangle"},
    },
    "a light runner": {
        **{"model": "lugre", "preload": 0.256, "mu_s": 0.129, "mu_k": 0.133, "v_stribeck": 1.76e-3},
        **{"sigma_1": 2.298, "mass": 1e-6, "force": 0.074, "slewrate": 330.5, "amplitude": 114.0},
        **{"frequency": 59.73},
    },
    "a stiff contact": {
        **{"model": "lugre", "preload": 2.0, "mu_s": 0.52, "mu_k": 10.0, "v_stribeck": 0.479},
        **{"sigma_0": 1e12, "sigma_1": 1.41, "mass": 1.9e-3, "force": -1000.0, "slewrate": 512.0},
        **{"amplitude": 66.9, "frequency": 1931.0},
    },
}


def positions(values: dict[str, Any], tolerance: float, cycles: int = 6) -> Any:
    """Return x (m) at the end of each cycle from rest."""
    p = Parameters.of(values)
    simulation = Simulation(Plant.of(p), tolerance)
    simulation.start(drive_of(p), cycles)
    return simulation.run_cycles(cycles).position


@pytest.mark.slow
@pytest.mark.parametrize("case", CARRIED_OFF)
def test_a_runner_that_the_load_carries_off(case: str) -> None:
    values = CARRIED_OFF[case]
    off = positions(values, 1e-11) - positions(values, 1e-14)
    assert np.abs(off).max() / len(off) < BAR


def test_momentum_of_a_runner_carried_off() -> None:
    """While sliding, force and friction alone speed it up: sigma_1 has given back all it took."""
    p = Parameters.of(CARRIED_OFF["damping of 1e6 N s/m"])
    plant = Plant.of(p)
    c = plant.contact
    simulation = Simulation(plant, 1e-11)
    times = np.array([0.0, 5e-3, 6e-3, 8e-3])
    found = simulation.sample(times)
    pull = plant.force + c.sigma_0 * c.z_k
    # mass v + sigma_1 z is what the forces have given; by then z is at its limit
    momentum = plant.mass * found.v + c.sigma_1 * found.z
    given = pull * times[1:]
    short = momentum[1:] - given  # what friction took less before z came to its limit
    assert np.abs(short - short[0]).max() < 1e-12 * abs(given[-1])
    assert abs(short[0]) < c.sigma_0 * c.z_k * 5e-3


def test_printed_alpha_leads_along_the_limit() -> None:
    """Filippov's sliding mode: z = z_lim(w), so t follows from w by quadrature.

    As printed, alpha jumps to 1 at z_ss = z_lim(w) for z < 0. A limit that rises with w then takes
    z along: (m + sigma_1 z_lim'(w)) w' = F_ext - sigma_0 z_lim(w).
    """
    p = Parameters.of(
        {
            **{"model": "epm_calc", "alpha_form": "printed", "preload": 2.0, "mass": 0.25},
            **{"mu_s": 0.8, "mu_k": 1.0, "v_stribeck": 0.05, "sigma_0": 1.6e6, "sigma_1": 80.0},
            **{"z_ba": 4e-8, "force": -3.0},
        }
    )
    plant = Plant.of(p)
    c = plant.contact
    simulation = Simulation(plant, 1e-11, budget=2000)
    times = np.linspace(0.0, 0.02, 201)
    found = simulation.sample(times)

    def limit(w: float) -> float:
        return c.z_k + (c.z_s - c.z_k) * math.exp(-((w / c.v_s) ** 2))

    def time_per_speed(w: float) -> float:
        slope = -2.0 * w / c.v_s**2 * (limit(w) - c.z_k)
        return (plant.mass + c.sigma_1 * slope) / (3.0 - c.sigma_0 * limit(w))

    w = -found.v
    on = np.flatnonzero([abs(z + limit(v)) < 1e-15 for z, v in zip(found.z, w, strict=True)])
    assert len(on) > 150
    first, last = on[0], on[-1]
    taken, _ = quad(time_per_speed, w[first], w[last], epsabs=0.0, epsrel=1e-12)
    assert taken == pytest.approx(times[last] - times[first], rel=1e-10)


@pytest.mark.parametrize(
    "values",
    [
        {"force": -0.4775, "inclination": 2.69, "mu_s": 0.773, "mu_k": 0.996, "v_stribeck": 0.0464},
        {"mu_s": 10.0, "mu_k": 0.0786, "v_stribeck": 1.88e-4, "mass": 1000.0},
        {"force": 100.0, "mu_s": 0.19, "mu_k": 0.1, "v_stribeck": 0.66, "sigma_2": 6.6e-7},
        {"model": "epm_fix", "sigma_2": 1e6, "force": -1000.0, "v_stribeck": 0.119},
        {"model": "epm_fix", "force": 1000.0, "sigma_2": 9.4e-4, "v_stribeck": 0.017},
    ],
    ids=str,
)
def test_printed_alpha_takes_few_arcs(values: dict[str, Any]) -> None:
    """Once z was thrown back and forth across its limit, hundreds of thousands of times a cycle."""
    p = Parameters.of(
        {
            **{"model": "epm_calc", "alpha_form": "printed", "preload": 2.0, "mass": 0.25},
            **{"sigma_0": 1.62e6, "sigma_1": 79.0, "z_ba": 3.96e-8, "frequency": 1200.0, **values},
        }
    )
    simulation = Simulation(Plant.of(p), 1e-11, budget=20_000)
    simulation.start(drive_of(p), 3)
    assert np.isfinite(simulation.run_cycles(3).position).all()


def test_an_implicit_step_does_not_silence_the_ringing() -> None:
    """A contact that rings under its Stribeck curve: one step was once as long as half a cycle."""
    values = {
        **{"model": "lugre", "preload": 0.0778, "mu_s": 0.5334, "mu_k": 0.7481},
        **{"v_stribeck": 1.422e-6, "sigma_0": 6.919e7, "sigma_1": 0.9807, "mass": 1.243e-3},
        **{"spring": 67877.7, "slewrate": 493.2, "amplitude": 222.75, "frequency": 24.247},
        "waveform": "triangle",
    }
    off = positions(values, 1e-12, 2) - positions(values, 1e-14, 2)
    assert np.abs(off).max() < 1e-12


def test_heat_of_a_heavy_or_a_fast_drive_is_negative_by_rounding_alone() -> None:
    """Without damping or slip there is none: what is left is the rounding of speeds."""
    p = Parameters.of(
        {"preload": 0.34, "sigma_1": 0.0, "z_ba": 1e-3, "mass": 1000.0, "slewrate": 270.0}
    )
    drive = drive_of(p)
    simulation = Simulation(Plant.of(p), 1e-11)
    simulation.start(drive, 6)
    rounding = np.finfo(float).eps * 1000.0 * np.abs(drive.rates).max() ** 2
    assert np.abs(simulation.run_cycles(6).lost).max() < 4.0 * rounding


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (
            {"model": "lugre", "preload": 1.0, "mu_k": 0.19, "mu_s": 1.0, "sigma_0": 1e12},
            r"z_k of the contact is 1\.9e-13 m.*far below an atom.*change sigma_0ss",
        ),
        (
            {"model": "lugre", "mu_k": 0.2, "mu_s": 0.3, "v_stribeck": 1e3},
            r"v_stribeck is 1000 m/s, 10 m/s is the upper limit.*measured.*lower it",
        ),
        (
            {"mass": 1e-6, "force": -1000.0},
            r"load of -1000 N .* by 1e\+09 m/s\^2, 1e\+06 m/s\^2 is the upper limit.*lower force",
        ),
        ({"spring": 1e9}, r"spring is 1e\+09 N/m, 1e\+08 N/m is the upper limit.*steel.*lower it"),
        ({"z_ba": 1e-100}, "z_ba is 1e-100 m"),
        ({"sigma_0ss": 5e-324}, "sigma_0ss is 4.94066e-324 N/m.*between 1 and"),
        ({"sigma_0ss": 1.0}, "z_k of the contact is 0.08 m.*change sigma_0ss"),
        ({"z_ba": 30e-9, "z_ss": 30e-9 * (1.0 + 1e-9)}, "z_ss has to be larger"),
    ],
    ids=lambda case: " ".join(case) if isinstance(case, dict) else "",
)
def test_what_no_axis_has_is_refused(values: dict[str, Any], words: str) -> None:
    with pytest.raises(ParameterError, match=words):
        Plant.of(Parameters.of(values))


def test_without_a_curve_any_stribeck_velocity_will_do() -> None:
    Plant.of(Parameters.of({"model": "lugre", "mu_k": 0.2, "mu_s": 0.2, "v_stribeck": 1e3}))


def test_an_implicit_step_without_a_solution_at_its_event_is_not_taken() -> None:
    """A heavy runner on the printed law, at a finer tolerance: once its place was not a number."""
    p = Parameters.of(
        {
            **{"model": "epm_calc", "alpha_form": "printed", "preload": 4.0757, "mu_s": 0.63066},
            **{"mu_k": 0.16594, "v_stribeck": 3.67974, "sigma_0": 310059.4, "sigma_1": 0.83923},
            **{"z_ba": 2.51233e-7, "mass": 1000.0, "force": -0.47772, "inclination": 3.068717},
            **{"slewrate": 198.08, "amplitude": 255.523, "frequency": 186.45475},
        }
    )
    rough, fine = (positions(p.flat(), tolerance) for tolerance in (1e-11, 1e-14))
    assert np.abs(rough - fine).max() / 6 < BAR


def test_friction_is_known_well_where_the_contact_is_stiff() -> None:
    """Limits of z shorter than the tolerance: a creep on the Stribeck curve was 12 nm off."""
    values = {
        **{"model": "lugre", "preload": 11.917, "mu_s": 0.09009, "mu_k": 0.69271},
        **{"v_stribeck": 1.3775e-6, "sigma_0": 1e12, "sigma_1": 0.62418, "mass": 2.2343e-3},
        **{"force": 3.4982, "slewrate": 20.85, "amplitude": 68.1, "frequency": 73.155},
    }
    off = positions(values, 1e-11, 2) - positions(values, 1e-14, 2)
    assert np.abs(off).max() / 2 < BAR


def test_a_narrow_stribeck_curve() -> None:
    """20 steps were 10 nm off before the Stribeck curve was in the error control."""
    values = {
        **{"model": "epm_calc", "preload": 1.03, "mass": 0.01226, "sigma_1": 5.8},
        **{"sigma_0": 4.28e6, "mu_s": 0.3855, "mu_k": 0.1127, "v_stribeck": 6.1e-5},
        **{"z_ba": 2.22e-8, "amplitude": 168.0, "frequency": 3490.0, "slewrate": 233.0},
    }
    found, fine = (positions(values, tolerance, 20) for tolerance in (1e-11, 1e-14))
    assert abs(found[-1] - fine[-1]) < 20e-12
    assert found[-1] == pytest.approx(1360.189e-9, abs=0.01e-9)
    p = Parameters.of(values)
    true = judge.positions(Plant.of(p), drive_of(p), 2)
    np.testing.assert_allclose(found[:2], true, atol=2e-12)
