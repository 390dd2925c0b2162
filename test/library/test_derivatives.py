# SPDX-License-Identifier: Apache-2.0
"""Derivatives of steps: against closed forms, against each other, against converged differences."""

from itertools import islice
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

import stickslip_ros as ss
from stickslip_ros.library.waveform_search import ringing_and_step
from stickslip_ros.model import Plant, drive_of
from stickslip_ros.solver import Simulation
from validation.campaigns.sensitivities import RIGHT, differs, drawn, judged

QUICK = {"frequency": 2000.0}
LAWS: list[dict[str, Any]] = [
    {},
    {"model": "ceim_without_mu", "contacts": 3, "contact_spread": 0.2},
    {"model": "ceim_ageing", "beta": 0.05},
    {"model": "lugre", "mu_s": 0.3, "mu_k": 0.2, "spring": 1e5},
    {"model": "epm_fix", "force": 0.02},
    {"model": "epm_calc", "preload": 1.0, "mu_s": 0.4, "inclination": 0.3},
]


@pytest.mark.slow
@pytest.mark.parametrize("values", LAWS)
def test_the_values_are_those_of_simulate(values: dict[str, Any]) -> None:
    p = ss.Parameters.of(QUICK | values)
    found = ss.sensitivities(p, by=(), steps=-6).values
    simulation = Simulation(Plant.of(p), 1e-13)
    simulation.start(drive_of(p, -1), 7)
    np.testing.assert_allclose(found.position, simulation.run_cycles(6).position, atol=1e-13)
    simulation.restart()
    simulation.start(drive_of(p, -1), 7)
    rise, period = drive_of(p).durations[0], drive_of(p).period
    slip = simulation.sample(5 * period + rise + np.linspace(0.0, 0.9 * period, 100_001))
    turns = np.flatnonzero((slip.v[:-1] > 0.0) & (slip.v[1:] <= 0.0))
    after = turns[turns > 100_000 * (period - rise) / (0.9 * period)]
    deepest = float(np.max(slip.x[: after[0] + 2] - slip.x[0]))
    assert found.backstep[5] == pytest.approx(deepest, abs=1e-12)


def test_ringing_is_that_of_the_search_without_its_samples() -> None:
    found = ss.sensitivities(QUICK, by=(), steps=30).values
    assert found.ringing[-1] == pytest.approx(
        ringing_and_step(ss.Parameters.of(QUICK))[0], rel=1e-3
    )


def test_an_elastic_contact_as_matrix_exponentials_give_it() -> None:
    """A triangle that no contact gives way to: the kink moves, and so does what follows.

    A solver that keeps the time of the kink gets 0 here, one that differentiates through its steps
    alone gets what its steps happen to be (diffrax 729, OrdinaryDiffEq 4388).
    """
    p = ss.Parameters.of(QUICK | {"waveform": "triangle", "amplitude": 10.0, "preload": 1.0})
    plant, drive = Plant.of(p), drive_of(p)
    c, (first, second), (up, down) = plant.contact, drive.durations, drive.rates
    rates = np.array([  # of x - u and v, at u' = 0
        [0.0, 1.0], [-c.sigma_0 / plant.mass, -c.sigma_1 / plant.mass],
    ])  # fmt: skip
    by_rate = np.array([-1.0, c.sigma_1 / plant.mass])
    ahead = expm(rates * first) - np.eye(2)
    kink = np.linalg.solve(rates, ahead @ by_rate * up)
    # Later by dt with the levels as they were: both rates change, and the moment at which they do.
    up_by, down_by = -up / first, down / second
    kink_by = rates @ kink + by_rate * up + np.linalg.solve(rates, ahead @ by_rate * up_by)
    after = expm(rates * second)
    steady = np.linalg.solve(rates, (after - np.eye(2)) @ by_rate)
    end_by = after @ kink_by + steady * down_by
    end_by -= rates @ (after @ kink + steady * down) + by_rate * down
    found = ss.sensitivities(p, by=(), steps=1)
    end = after @ kink + steady * down
    assert np.abs([kink[0], end[0]]).max() < c.z_ba
    assert found.values.position[0] == pytest.approx(end[0], rel=1e-9)
    assert found.by_time.position[0, 0] == pytest.approx(end_by[0], rel=1e-9)
    assert found.by_time.position[0, 0] != pytest.approx(0.0, abs=1e-7)


def test_parameters_of_the_waveform_are_moves_of_its_kinks() -> None:
    p = ss.Parameters.of(QUICK | {"waveform": "hold", "hold_before": 0.2, "hold_after": 0.1})
    found = ss.sensitivities(p, by=["hold_before", "gain"], steps=4)
    period, levels = 1.0 / 2000.0, np.cumsum(drive_of(p).durations * drive_of(p).rates)[:-1]
    for name, by_hold in found.by["hold_before"]._asdict().items():
        of_kinks = -period * getattr(found.by_time, name)[0]
        if name != "ringing":  # its window is longer, too
            np.testing.assert_allclose(by_hold, of_kinks, rtol=1e-6)
        by_gain = levels @ getattr(found.by_level, name) / p.actuator.gain
        np.testing.assert_allclose(getattr(found.by["gain"], name), by_gain, rtol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("count", [6, pytest.param(500, marks=pytest.mark.long)])
def test_random_drives_against_converged_differences(count: int) -> None:
    errors = []
    for _, p, names in islice(drawn(3), count):
        try:
            errors += [error for _, error in judged(p, names)]
        except ss.ParameterError:  # no such contact
            continue
    known = [error for error in errors if error == error]
    assert len(known) > 0.8 * len(errors) > count
    assert max(known) < RIGHT


@pytest.mark.slow
def test_a_step_over_the_top_of_a_swing_leaves_out_no_yielding() -> None:
    """Swings end just beyond z_ba, one after the other; the third step was 8e-5 off by the mass."""
    p = ss.Parameters.of(
        preload=0.9430475146661687, mu=0.05728873040534577, mu_s=0.7815061584603952,
        mu_k=0.397161202868615, v_stribeck=0.0008430854232483212, sigma_1=0.9439863610917523,
        contacts=2, contact_spread=0.1, mass=0.009529081149384996, force=0.004235708396412725,
        slewrate=16.77841131532556, amplitude=76.27845591507658, frequency=63.801243700825474,
        waveform="hold", hold_before=0.10345612249095436, hold_after=0.19401227984203973,
    )  # fmt: skip
    errors = dict(judged(p, ["mass"]))
    assert errors["position by mass"] < RIGHT and errors["backstep by mass"] < RIGHT


@pytest.mark.parametrize(
    ("values", "by", "words"),
    [
        ({"actuator_resonance": 1e5}, (), "are without an actuator that follows its command"),
        ({"alpha_form": "printed"}, (), "without alpha as printed, which jumps"),
        ({"slip_spread": 0.1}, (), "without contacts that vary from step to step"),
        ({}, ["waveform"], "waveform is sawtooth: give numbers that are set"),
        ({}, ["sigma_0"], "sigma_0 is None: give numbers"),
        ({"waveform": "hold"}, ["hold_before"], "by hold_before at 0: the waveform changes"),
        ({}, ["preloadd"], "did you mean"),
    ],
)
def test_what_has_no_derivative(values: dict[str, Any], by: Any, words: str) -> None:
    with pytest.raises(ss.ParameterError, match=words):
        ss.sensitivities(values, by=by)


def test_the_end_of_a_range_has_a_derivative_to_one_side() -> None:
    """300 V is all that the actuator takes, and 0 the least viscous friction."""
    found = ss.sensitivities(QUICK, by=["amplitude", "sigma_2"], steps=2)
    less = ss.sensitivities(QUICK, by=["amplitude"], amplitude=299.9, steps=2)
    assert found.by["amplitude"].position[-1] == pytest.approx(
        less.by["amplitude"].position[-1], rel=1e-2
    )
    slowed = ss.sensitivities(QUICK, by=(), sigma_2=1e-4, steps=2).values.position[-1]
    wanted = (slowed - found.values.position[-1]) / 1e-4
    assert found.by["sigma_2"].position[-1] == pytest.approx(wanted, rel=1e-3)


def test_an_overdamped_contact_does_not_ring() -> None:
    found = ss.sensitivities(QUICK, by=["sigma_1"], sigma_1=1e4, steps=2)
    assert np.isnan(found.values.ringing).all()
    assert np.isfinite(found.by["sigma_1"].position).all()


def test_events_are_named() -> None:
    events = ss.sensitivities(QUICK, by=(), steps=2).events
    assert events[:3] == (
        (1, "segment 1 begins"), (1, "segment 2 begins"), (1, "contact 1 passes z_ba"),
    )  # fmt: skip
    assert {"w turns", "the runner turns"} <= {event for cycle, event in events if cycle == 2}
    more = ss.sensitivities(QUICK, by=(), steps=2, preload=0.5).events
    assert differs(events, events) == ""
    assert differs(events, more).startswith("cycle ")
