# SPDX-License-Identifier: Apache-2.0
"""Steps that vary along the way and from cycle to cycle: statistics, places that stay, energy."""

import math
from typing import Any

import numpy as np
import pytest
from table_1 import table_1

from stickslip_ros.model import Plant, drive_of
from stickslip_ros.model.surface import CycleStart, Surface
from stickslip_ros.solver import Simulation
from stickslip_ros.solver.driven import simulation_of

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
    """A symmetric drive to and fro: contacts at equal places are equal."""
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
