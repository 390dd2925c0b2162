# SPDX-License-Identifier: Apache-2.0
"""What every friction law has to do in motion: scale with units, have its limits, hold still."""

import math
from typing import Any

import numpy as np
import pytest
from table_1 import TABLE_1, table_1

from stickslip_ros.physics.laws import LEFT_TO_LAW
from stickslip_ros.physics.model import LAWS, DriveCycle, Plant, friction_force, z_rate
from stickslip_ros.physics.model.friction import constants_in_force
from stickslip_ros.physics.parameters import Parameters
from stickslip_ros.physics.solver import Simulation
from stickslip_ros.simulation.steps import run_steps

#: Constants of these laws, spelt out; of any other law see `_spelt_out`.
SPELT_OUT: dict[str, dict[str, Any]] = {
    "ceim": {"sigma_0ss": 1e7},
    "ceim_without_mu": {"sigma_0ss": 5e7},
    "lugre": {"sigma_0": 1e6},
    "epm_fix": {"sigma_0": 1e6, "z_ba": 50e-9, "z_ss": 100e-9},
    "epm_calc": {"sigma_0": 1e6, "z_ba": 100e-9, "preload": 0.8},
}
#: Dimension of each parameter that has one: exponents of mass, length and time.
DIMENSIONS = {
    "preload": (1, 1, -2),
    "force": (1, 1, -2),
    "spring": (1, 0, -2),
    "mass": (1, 0, 0),
    "v_stribeck": (0, 1, -1),
    "sigma_0": (1, 0, -2),
    "sigma_0ss": (1, 0, -2),
    "sigma_0_slope": (0, -1, 0),
    "sigma_0_offset": (1, 0, -2),
    "sigma_1": (1, 0, -1),
    "sigma_2": (1, 0, -1),
    "z_ba": (0, 1, 0),
    "z_ss": (0, 1, 0),
    "z_ba_slope": (-1, 0, 2),
    "z_ba_offset": (0, 1, 0),
    "gain": (0, 1, 0),
    "frequency": (0, 0, -1),
    "slewrate": (0, 0, -1),
    "tolerance": (0, 1, 0),
}


def _spelt_out(law: str) -> dict[str, Any]:
    """Return constants as parameters, so that the law puts in none of its own."""
    own = constants_in_force(table_1(model=law).friction)
    filled = {name: getattr(own, name) for name in LEFT_TO_LAW}
    return SPELT_OUT.get(law, {name: value for name, value in filled.items() if value is not None})


#: Laws of the form of `Contact`; others have tests of their own in test/laws
OF_CONTACT = [name for name, law in LAWS.items() if not law.rate]
each_law = pytest.mark.parametrize("law", OF_CONTACT)


def _in_other_units(p: Parameters, units: tuple[float, float, float]) -> Parameters:
    """Return the same axis with its numbers in other units of mass, length and time."""
    factors = {
        name: math.prod(unit**power for unit, power in zip(units, powers, strict=True))
        for name, powers in DIMENSIONS.items()
    }
    return Parameters.of({name: value * factors.get(name, 1.0) if name in factors else value
                  for name, value in p.flat().items()})  # fmt: skip


#: Table 2 with 3 g
TABLE_2 = {"mass": 3e-3, "sigma_1": 5.0, "mu_s": 0.3, "mu_k": 0.2, "v_stribeck": 1e-3}


def test_steps_of_the_elastoplastic_laws() -> None:
    """Against an integration made elsewhere: Fig. 5, its negative steps with alpha as printed."""
    for values, step in [
        ({"model": "epm_fix", "preload": 0.1}, 90.99),
        ({"model": "epm_fix", "preload": 0.4}, 68.26),
        ({"model": "epm_fix", "preload": 1.0}, 32.67),
        ({"model": "epm_fix", "preload": 2.0}, 15.76),
        ({"model": "epm_fix", "preload": 5.0}, 6.16),
        ({"model": "epm_calc", "alpha_form": "printed", "preload": 1.0}, 3.77),
        ({"model": "epm_calc", "alpha_form": "printed", "preload": 1.04}, 0.71),
        ({"model": "epm_calc", "alpha_form": "printed", "preload": 1.06}, -0.77),
        ({"model": "epm_calc", "alpha_form": "printed", "preload": 1.5}, -10.68),
        ({"model": "epm_calc", "preload": 1.5}, 1.73),
    ]:
        steps = run_steps({**TABLE_1, **TABLE_2, **values}, 30)
        assert steps.step_size * 1e9 == pytest.approx(step, abs=0.02)


@each_law
@pytest.mark.parametrize(
    "units", [(2.0, 1.0, 1.0), (1.0, 4.0, 1.0), (1.0, 1.0, 0.5), (8.0, 0.25, 2.0)]
)
def test_a_run_knows_no_units(law: str, units: tuple[float, float, float]) -> None:
    """Positions scale with the unit of length, but for rounding.

    A constant with a dimension hidden in a law or in the solver would show here.
    """
    own = {"model": law, **_spelt_out(law), "force": -0.02, "spring": 2e3, "sigma_2": 0.1}
    p = table_1(**{**own, "frequency": 500.0, "tolerance": 4e-12})
    there, scaled = run_steps(p, 15), run_steps(_in_other_units(p, units), 15)
    np.testing.assert_allclose(scaled.position, units[1] * there.position, rtol=1e-13)
    assert scaled.backstep == pytest.approx(units[1] * there.backstep, rel=1e-13)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_without_elastic_range_the_elastoplastic_law_loads_as_lugre_does(sign: float) -> None:
    """z_ba and z_ss to 0: alpha is 1 while the contact loads; unloading stays elastic (Dupont)."""
    shared = {"sigma_0": 1e6, "mu": 0.2, "mu_s": 0.2, "mu_k": 0.2, "sigma_0ss": 1e6}
    plastic = Plant.of(table_1(**{"model": "lugre", **shared})).contact
    elastic = Plant.of(table_1(**{"model": "ceim", **shared, "z_ba": 1e-15, "z_ss": 2e-15})).contact
    assert elastic.z_k == pytest.approx(plastic.z_k)
    for z in sign * np.array([1e-9, 20e-9, 79e-9, 200e-9]):
        for w in sign * np.array([1e-6, 1e-3, 0.1]):
            assert z_rate(z, w, elastic) == pytest.approx(z_rate(z, w, plastic), rel=1e-12)
            assert z_rate(z, -w, elastic) == -w
            assert z_rate(z, -w, plastic) != -w


@pytest.mark.parametrize("law", ["lugre", "ceim"])
def test_a_slide_without_elastic_range_is_the_exponential_of_lugre(law: str) -> None:
    """A heavy runner on an actuator that slides away under it: z = z_lim (1 - exp(-path/z_lim))."""
    shared = {"sigma_0": 1e6, "mu": 0.2, "mu_s": 0.2, "mu_k": 0.2, "sigma_0ss": 1e6, "mass": 100.0}
    z_ba = {} if law == "lugre" else {"z_ba": 1e-15, "z_ss": 2e-15}
    p = table_1(**{"model": law, **shared, **z_ba})
    simulation = Simulation(Plant.of(p), p.solver.tolerance)
    simulation.start(DriveCycle(np.array([1e-3, 1e-3]), np.array([-1e-3, 1e-3]), 1, 1), 1)
    limit = 0.2 * p.friction.preload / 1e6
    for t in (1e-5, 5e-5, 2e-4, 9e-4):
        simulation.advance(t)
        state = simulation.state
        path = state.x - state.u
        assert path > 0.0
        assert state.z == pytest.approx(limit * (1.0 - math.exp(-path / limit)), abs=1e-12)


@each_law
def test_viscous_friction_is_there_only_where_it_is_set(law: str) -> None:
    p = table_1(**{"model": law, **_spelt_out(law)})
    dry, wet = Plant.of(p).contact, Plant.of(p.replace(sigma_2=3.0)).contact
    for z, w in ((1e-8, 0.1), (-2e-7, 1e-3), (1e-7, -0.05)):
        assert friction_force(z, w, wet) - friction_force(z, w, dry) == pytest.approx(3.0 * w)
    assert run_steps(p.replace(sigma_2=3.0), 12).step_size != run_steps(p, 12).step_size


@pytest.mark.parametrize("law", ["lugre", "epm_calc"])
def test_stribeck_needs_two_coefficients(law: str) -> None:
    """With mu_s = mu_k the Stribeck velocity changes nothing, otherwise it does (Eq. 4)."""
    p = table_1(**{"model": law, **_spelt_out(law), "mu_s": 0.2})
    assert np.array_equal(
        run_steps(p, 5).position, run_steps(p.replace(v_stribeck=0.5), 5).position
    )
    p = p.replace(mu_s=0.3)
    assert not np.array_equal(
        run_steps(p, 5).position, run_steps(p.replace(v_stribeck=0.5), 5).position
    )


def _drift(values: dict[str, Any], cycles: int, replay: bool) -> np.ndarray:
    """Return positions (m) at the end of cycles of a vibrating load below breakaway.

    Seen from the actuator, its vibration is a load -m u'' on the runner: a triangle of 2 nm at
    1 kHz kicks it back and forth, 8e-6 m/s each. A constant force of a third of the breakaway pulls
    on top.
    """
    p = table_1(**values)
    simulation = Simulation(Plant.of(p), p.solver.tolerance, replay)
    simulation.start(DriveCycle(np.full(2, 5e-4), np.array([4e-6, -4e-6]), 1, 1), cycles)
    return simulation.run_cycles(cycles).position


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    "values",
    [
        {"model": "ceim", "force": 0.054},
        {"model": "ceim_without_mu", "force": 0.054},
        {"model": "epm_fix", "sigma_0": 1e6, "force": 0.016},
        {"model": "epm_calc", "sigma_0": 1e6, "preload": 0.8, "force": 0.033},
    ],
    ids=lambda values: values["model"] if isinstance(values, dict) else None,
)
def test_below_breakaway_a_vibrating_load_moves_nothing(
    values: dict[str, Any], sign: float
) -> None:
    """Section 3: 1e5 cycles of the load do not move it, LuGre creeps by tens of micrometres.

    Cycles that are replayed repeat what was left of settling when they began to, each time: less
    than a thousandth of the tolerance a cycle.
    """
    values = {**values, "force": sign * values["force"]}
    contact = Plant.of(table_1(**values)).contact
    assert abs(values["force"]) / contact.sigma_0 == pytest.approx(contact.z_ba / 3, rel=0.05)
    cycles, tolerance = 100_000, table_1(**values).solver.tolerance
    still = _drift(values, cycles, replay=False)
    assert still[-1] == pytest.approx(values["force"] / contact.sigma_0, abs=1e-9)
    assert abs(still[-1] - still[1_000]) < 1e-15
    replayed = _drift(values, cycles, replay=True)
    assert abs(replayed[-1] - still[-1]) < 1e-3 * tolerance * cycles
    creeping = _drift({**values, "model": "lugre", "sigma_0": contact.sigma_0}, cycles, True)
    assert sign * (creeping[-1] - creeping[1_000]) > 1e-5
