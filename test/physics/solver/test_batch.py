# SPDX-License-Identifier: Apache-2.0
"""A batch gives every point what a simulation of that point gives, to the last bit."""

import numpy as np
import pytest
from numpy.typing import NDArray
from table_1 import table_1

from stickslip_ros.physics.model import LAWS, Plant, drive_of
from stickslip_ros.physics.parameters import Parameters
from stickslip_ros.physics.solver import Simulation
from stickslip_ros.physics.solver.simulation import backstep_into_rest
from stickslip_ros.simulation.operating_points import batch_of

POINTS, STEPS = 24, 9


def columns(model: str, seed: int = 0) -> Parameters:
    """Operating points at random: with and without load, slow and fast, weak and firm."""
    draw = np.random.default_rng(seed)
    return table_1(model=model).replace(
        preload=draw.uniform(0.6, 4.0, POINTS),
        mass=draw.uniform(3e-3, 15e-3, POINTS),
        amplitude=draw.uniform(10.0, 300.0, POINTS),
        frequency=10.0 ** draw.uniform(1.5, 4.3, POINTS),
        slewrate=draw.uniform(50.0, 1000.0, POINTS),
        force=draw.choice([0.0, 0.02], POINTS),
        spring=draw.choice([0.0, 1e4], POINTS),
        inclination=draw.uniform(-1.0, 1.0, POINTS),
        sigma_0_cap=draw.choice([0.0, 2.0], POINTS),
    )


def alone(
    p: Parameters, sign: int, steps: int = STEPS
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Position and backstep of one point, by a simulation of its own."""
    simulation = Simulation(Plant.of(p), p.solver.tolerance)
    simulation.start(drive_of(p, sign), steps)
    cycles = simulation.run_cycles(steps)
    if steps > 1:
        return cycles.position, cycles.backstep[1:]
    return cycles.position, np.array([backstep_into_rest(simulation)])


def everywhere(points: int = POINTS) -> NDArray[np.bool_]:
    return np.ones(points, dtype=bool)


@pytest.mark.parametrize(("sign", "steps"), [(1, STEPS), (-1, STEPS), (1, 1)])
@pytest.mark.parametrize("model", LAWS)
def test_every_point_is_as_if_it_were_alone(model: str, sign: int, steps: int) -> None:
    p = columns(model)
    many, possible = batch_of(p, POINTS, sign)
    assert possible.all()
    position, backstep = many.run(steps, everywhere())
    for k in range(POINTS):
        wanted = alone(p.point(k), sign, steps)
        np.testing.assert_array_equal(position[k], wanted[0])
        np.testing.assert_array_equal(backstep[k], wanted[1])


def test_points_left_out_are_nan_and_disturb_nobody() -> None:
    many, _ = batch_of(columns("ceim"), POINTS, 1)
    whole, _ = many.run(STEPS, everywhere())
    where = np.arange(POINTS) % 3 == 0
    some, backstep = many.run(STEPS, where)
    np.testing.assert_array_equal(some[where], whole[where])
    assert np.isnan(some[~where]).all()
    assert np.isnan(backstep[~where]).all()


def test_points_that_share_a_plant_are_as_if_they_were_alone() -> None:
    """A prepared plant is used again, whatever the order of the points."""
    p = columns("ceim")
    for name, value in p.flat().items():
        if isinstance(value, np.ndarray) and name not in ("amplitude", "frequency", "tolerance"):
            p = p.replace(**{name: np.resize(value[:3], POINTS)})
    p = p.replace(tolerance=np.resize([1e-12, 1e-11], POINTS))
    many, _ = batch_of(p, POINTS, 1)
    position, _ = many.run(STEPS, everywhere())
    for k in range(POINTS):
        np.testing.assert_array_equal(position[k], alone(p.point(k), 1)[0])


def test_a_batch_takes_one_plant_for_all_points() -> None:
    p = table_1().replace(amplitude=np.array([150.0, 300.0]))
    many, _ = batch_of(p, 2, 1)
    position, _ = many.run(STEPS, everywhere(2))
    np.testing.assert_array_equal(position[1], alone(p.point(1), 1)[0])


def test_run_until_still_ends_where_the_mean_position_no_longer_rises() -> None:
    p = table_1(spring=1e6, frequency=1000.0).replace(preload=np.array([0.4, 2.0]))
    p = p.replace(amplitude=np.array([300.0, 300.0]))
    many, _ = batch_of(p, 2, 1)
    final = many.run_until_still(10, 1e-10, 10_000, everywhere(2))
    for k in range(2):
        simulation = Simulation(Plant.of(p.point(k)), p.solver.tolerance)
        simulation.start(drive_of(p.point(k)), 2000)
        means = simulation.run_cycles(2000).position.reshape(-1, 10).mean(axis=1)
        still = int(np.argmax(np.diff(means) < 1e-10)) + 1
        assert final[k] == pytest.approx(means[still], rel=1e-12)


def test_run_until_still_gives_up_at_the_limit_and_mirrors() -> None:
    p = table_1().replace(amplitude=np.array([300.0]))
    many, _ = batch_of(p, 1, 1)
    assert np.isnan(many.run_until_still(10, 1e-10, 100, everywhere(1))).all()
    pushing = p.replace(spring=1e6)
    forward, backward = (
        batch_of(pushing, 1, sign)[0].run_until_still(10, 1e-10, 1000, everywhere(1))
        for sign in (1, -1)
    )
    assert forward == pytest.approx(-backward, rel=1e-12)


def test_an_axis_rests_for_a_period_or_until_it_has_swung_once() -> None:
    for hertz in (1000.0, 20_000.0):
        p = table_1(frequency=hertz)
        simulation = Simulation(Plant.of(p), p.solver.tolerance)
        simulation.start(drive_of(p), 1)
        simulation.run_cycles(1)
        backstep_into_rest(simulation)
        swing = 1.0 / simulation.plant.ringing_frequency
        assert simulation.t == pytest.approx(1.0 / hertz + max(1.0 / hertz, swing), rel=1e-12)
