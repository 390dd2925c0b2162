# SPDX-License-Identifier: Apache-2.0
"""The closed form against an independent integrator and, at random points, against the solver."""

import json
from collections.abc import Callable

import numpy as np
import pytest
from table_1 import OVER_PRELOAD, OVER_STROKE, table_1

import stickslip_ros as ss
from stickslip_ros.cli.main import main
from stickslip_ros.physics.model import Plant
from stickslip_ros.physics.parameters import Parameters
from stickslip_ros.simulation.operating_points import steps_of
from stickslip_ros.simulation.prediction import (
    RANGES,
    Numbers,
    PredictionError,
    predict,
    steps_over,
)

TABLE_1 = table_1()


def random_points(seed: int, count: int) -> Parameters:
    """Points over the range of Table 1, with contacts up to a factor of 2 from the paper's."""
    random = np.random.default_rng(seed)

    def between(low: float, high: float) -> np.ndarray:
        return np.exp(random.uniform(np.log(low), np.log(high), count))

    return Parameters().replace(
        mass=between(3e-3, 15e-3),
        preload=between(0.25, 20.0),
        frequency=between(1.0, 1e5),
        amplitude=random.uniform(1.0, 300.0, count),
        slewrate=between(50.0, 1000.0),
        sigma_0ss=between(0.5e7, 2e7),
        sigma_1=between(2.5, 25.0),
        sigma_0_slope=between(2.5e6, 1e7),
        sigma_0_offset=between(3.5e6, 14e6),
        z_ba_slope=between(1e-8, 4e-8),
        z_ba_offset=between(5e-9, 2e-8),
    )


def points_of_the_form(seed: int, count: int) -> Parameters:
    """Points over the range that the form is said to hold in, whatever contact they take."""
    random = np.random.default_rng(seed)

    def between(low: float, high: float) -> np.ndarray:
        return np.exp(random.uniform(np.log(low), np.log(high), count))

    low, high = RANGES["lambda"].low, RANGES["lambda"].high
    limit, zeta, tau = between(low, high), between(1e-3, 0.2), between(5e-3, 0.7)
    ratio = random.uniform(RANGES["s"].low, RANGES["s"].high, count)
    mass, preload, z_ba = between(1e-3, 0.02), between(0.1, 5.0), between(5e-9, 1e-7)
    sigma_0, amplitude = between(3e6, 3e7), between(5.0, 300.0)
    omega = np.sqrt(sigma_0 / mass)
    friction = Parameters().friction
    return Parameters().replace(
        mass=mass,
        preload=preload,
        z_ba=z_ba,
        z_ss=ratio * z_ba,
        sigma_0=sigma_0,
        sigma_0ss=friction.mu * friction.preload_ratio * preload / (limit * z_ba),
        sigma_1=2.0 * zeta * mass * omega,
        amplitude=amplitude,
        gain=between(2.0, 50.0) * z_ba / amplitude,
        slewrate=amplitude * omega / tau * 1e-6,
        frequency=between(1.0, 3e3),
    )


def shares(p: Parameters, count: int) -> tuple[float, float, int]:
    """Part of the points in the form's range whose error is as stated, of all and of stepping."""
    plant = Plant.column(p)
    numbers = Numbers(*np.broadcast_arrays(*Numbers.of(plant, p)))
    with np.errstate(all="ignore"):  # of points for which the form does not hold
        step, left = numbers.step()
    z_ba = np.asarray(plant.contact.z_ba)
    step, error = z_ba * step, z_ba * numbers.error(left)
    placed = numbers.with_range(left)
    holds = np.all(
        [(placed[k] >= r.low) & (placed[k] <= r.high) for k, r in RANGES.items()], axis=0
    )
    solved, _ = steps_of(p, count, 12, holds)
    holds &= np.isfinite(solved)
    kept = np.abs(step - solved) <= error
    stepping = holds & (solved > 1e-9)
    return float(kept[holds].mean()), float(kept[stepping].mean()), int(holds.sum())


@pytest.mark.long
def test_it_agrees_with_an_independent_integrator() -> None:
    """Over preload and over stroke."""
    for preload, step in OVER_PRELOAD.items():
        found = predict(TABLE_1.replace(preload=preload))
        assert found.step == pytest.approx(1e-9 * step, abs=found.error + 5e-12)
        assert found.step == pytest.approx(1e-9 * step, abs=2e-10)
    for stroke, steps in OVER_STROKE.items():
        for preload, step in zip((0.4, 1.0), steps, strict=True):
            found = predict(TABLE_1.replace(preload=preload, amplitude=stroke * 300.0 / 160.0))
            assert found.step == pytest.approx(1e-9 * step, abs=found.error + 5e-12)
            assert found.stroke - found.zero_offset == pytest.approx(found.step)


def test_a0_hardly_depends_on_the_stroke() -> None:
    """25.8 nm for strokes of 50 to 160 nm, as the solver has it."""
    offsets = [
        predict(TABLE_1.replace(amplitude=volts)).zero_offset for volts in (94.0, 150.0, 300.0)
    ]
    assert offsets == pytest.approx([25.9e-9] * 3, abs=3e-10)


@pytest.mark.parametrize("points", [random_points, points_of_the_form])
def test_the_stated_error_holds(points: Callable[[int, int], Parameters]) -> None:
    """Where the limit of z is short beside the stroke, the form was up to a thousand times off."""
    of_all, of_stepping, count = shares(points(1, 1500), 1500)
    assert count > 500
    assert of_all >= 0.99
    assert of_stepping >= 0.99


@pytest.mark.long
def test_the_stated_error_holds_at_ten_thousand_points() -> None:
    of_all, of_stepping, count = shares(random_points(2, 20_000), 20_000)
    assert count >= 10_000
    assert of_all >= 0.99
    assert of_stepping >= 0.99


@pytest.mark.parametrize(
    "step", [1e-9, *(pytest.param(one, marks=pytest.mark.long) for one in (30e-9, 120e-9))]
)
def test_the_inverse_finds_the_amplitude_of_a_step(step: float) -> None:
    found = predict(TABLE_1, step=step)
    assert found.step == pytest.approx(step, abs=1e-13)
    solved, _ = steps_of(TABLE_1.replace(amplitude=found.amplitude), 1, 12)
    assert solved[0] == pytest.approx(step, abs=found.error)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (
            {"frequency": 5000.0},
            "what the contact still rings when the next slip begins.*lower the frequency",
        ),
        ({"slewrate": 1.0, "frequency": 10.0}, "time of the slip.*raise the slewrate"),
        ({"sigma_1": 300.0}, "damping ratio.*0.2"),
        ({"z_ss": 19e-9}, "z_ss over z_ba, is 1.06"),
        ({"sigma_0ss": 1e9}, "limit of the deflection over breakaway distance, is 0.00444"),
        ({"model": "lugre"}, "model lugre has no closed form"),
        ({"waveform": "triangle"}, "sawtooth on a linear actuator, not for triangle"),
        ({"force": 0.01}, "without external force, here 0.01"),
        ({"sigma_2": 0.01}, "without sigma_2"),
    ],
)
def test_outside_of_its_range_it_refuses(values: dict[str, object], words: str) -> None:
    with pytest.raises(PredictionError, match=words):
        predict(TABLE_1.replace(**values))


@pytest.mark.long
def test_the_inverse_looks_where_the_form_holds() -> None:
    """At the largest voltage of a slow slip it has no step: a smaller one makes that wanted."""
    p = TABLE_1.replace(
        preload=1.6, sigma_0=2e7, sigma_0ss=4.5e6, sigma_1=0.36, z_ba=6.5e-8, z_ss=1.8e-7,
        mass=1.5e-3, gain=5.2e-8, slewrate=1.3, frequency=12.0,
    )  # fmt: skip
    found = predict(p, step=180e-9)
    assert found.step == pytest.approx(180e-9, abs=1e-13)
    assert found.amplitude < 10.0
    with pytest.raises(PredictionError, match=r"out of reach.*raise the slewrate"):
        predict(p, step=1e-6)


def test_a_step_out_of_reach_is_refused() -> None:
    for step, words in (
        (1e-6, "1000 nm is out of reach: 300 V make 133.9 nm, of a stroke of 160.*voltage$"),
        (138e-9, "138.0 nm is out of reach: 300 V make 133.9 nm, .* or lower the preload$"),
    ):
        with pytest.raises(PredictionError, match=words):
            predict(TABLE_1, step=step)
    assert predict(TABLE_1, preload=0.05, step=138e-9).step == pytest.approx(138e-9)
    with pytest.raises(PredictionError, match="the step is 0 m"):
        predict(TABLE_1, step=0.0)


@pytest.mark.long
def test_the_command_and_the_library_agree(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["predict", "--set", "preload=1.0", "--step", "5e-8", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["step"] == pytest.approx(5e-8)
    assert told["amplitude"] == ss.predict(preload=1.0, step=5e-8).amplitude


def test_many_amplitudes_at_once_are_each_of_them() -> None:
    """Also where the form does not hold, and where a slip takes longer than its cycle."""
    p = Parameters.of(preload=0.4, slewrate=0.5)
    volts = np.array([5.0, 20.0, 60.0, 120.0, 300.0])
    for one, *found in zip(volts.tolist(), *steps_over(p, volts), strict=True):
        try:
            wanted = ss.predict(p, amplitude=one)
            assert found == pytest.approx([wanted.step, wanted.error], rel=1e-12)
        except ss.PredictionError:
            assert np.isnan(found).all()
    drive = p.replace(slewrate=0.01)
    assert np.isnan(steps_over(drive.replace(amplitude=1.0), volts)[0]).all()


def test_what_the_form_is_without_is_said() -> None:
    found = ss.predict(preload=0.4, contacts=6, contact_shares="guide", creep=0.02)
    assert found.left_out == ("creep", "contacts")
    assert ss.predict(preload=0.4).left_out == ()
    assert ss.sweep(preload=[0.4], wear_rate=1e-9).left_out == ("wear_rate",)
