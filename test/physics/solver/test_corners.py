# SPDX-License-Identifier: Apache-2.0
"""Corners of the ranges in which the solver was once wrong or slow, found by the campaign."""

import math
from typing import Any

import numpy as np
import pytest
from found import FOUND
from scipy.integrate import quad

from stickslip_ros.physics.model import Plant, drive_of
from stickslip_ros.physics.parameters import ParameterError, Parameters
from stickslip_ros.physics.solver import Simulation
from validation import whole_system

#: Error allowed per cycle, m
BAR = 1e-11


def positions(values: dict[str, Any], tolerance: float, cycles: int = 6) -> Any:
    """Return x (m) at the end of each cycle from rest."""
    p = Parameters.of(values)
    simulation = Simulation(Plant.of(p), tolerance)
    simulation.start(drive_of(p), cycles)
    return simulation.run_cycles(cycles).position


@pytest.mark.parametrize("case", FOUND["carried_off"])
def test_a_runner_that_the_load_carries_off(case: str) -> None:
    """What its speed is off by stays with it."""
    values = FOUND["carried_off"][case]
    off = positions(values, 1e-11) - positions(values, 1e-14)
    assert np.abs(off).max() / len(off) < BAR


@pytest.mark.parametrize(
    ("case", "cycles", "tolerance", "bar"),
    [
        # One implicit step was once as long as half a cycle of the ringing.
        ("a contact that rings under its Stribeck curve", 2, 1e-12, 1e-12),
        # Its place was not a number: an implicit step without a solution at its event is not taken.
        ("a heavy runner on the printed law", 6, 1e-11, 6 * BAR),
        # A creep on the Stribeck curve was 12 nm off.
        ("limits of z shorter than the tolerance", 2, 1e-11, 2 * BAR),
        # 10 nm off in 20 steps before the Stribeck curve was in the error control.
        ("a narrow Stribeck curve", 20, 1e-11, 20e-12),
    ],
)
def test_a_finer_tolerance_finds_the_same(
    case: str, cycles: int, tolerance: float, bar: float
) -> None:
    values = FOUND["rough_steps"][case]
    rough, fine = (positions(values, one, cycles) for one in (tolerance, 1e-14))
    assert np.abs(rough - fine).max() < bar


def test_momentum_of_a_runner_carried_off() -> None:
    """While sliding, force and friction alone speed it up: sigma_1 has given back all it took."""
    p = Parameters.of(FOUND["carried_off"]["damping of 1e6 N s/m"])
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
            r"v_stribeck is 1000 m/s; it has to lie between 1e-06 and 10 m/s: measured",
        ),
        (
            {"mass": 1e-6, "force": -1000.0},
            r"load of -1000 N .* by 1e\+09 m/s\^2, 1e\+06 m/s\^2 is the upper limit.*lower force",
        ),
        ({"spring": 1e9}, r"spring is 1e\+09 N/m; it has to lie between 0 and 1e\+08 N/m.*steel"),
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


def test_a_narrow_stribeck_curve_is_that_of_another_integrator() -> None:
    values = FOUND["rough_steps"]["a narrow Stribeck curve"]
    found = positions(values, 1e-11, 20)
    assert found[-1] == pytest.approx(1360.189e-9, abs=0.01e-9)
    true = whole_system.positions(Parameters.of(values), 2)
    np.testing.assert_allclose(found[:2], true, atol=2e-12)
