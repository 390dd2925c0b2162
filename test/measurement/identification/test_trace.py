# SPDX-License-Identifier: Apache-2.0
"""Blocks of samples, the noise and the errors of a sensor."""

from dataclasses import replace

import numpy as np
import pytest
from experiments import small

from stickslip_ros.measurement.identification.experiment import Experiment, Stepping
from stickslip_ros.measurement.identification.trace import Blocks, Seen, Trace
from stickslip_ros.measurement.steps.ringing import Ringing
from stickslip_ros.physics.parameters import Parameters
from stickslip_ros.simulation.motion import Motion

KNOWN = Parameters.of({"frequency": 100.0, "amplitude": 300.0, "preload": 0.5, "mass": 5e-3})
RINGING = Ringing(7e3, 700.0)


def record(t: np.ndarray, x: np.ndarray, samples: str | None = None) -> Experiment:
    """A record of four steps that begin after 10 ms."""
    run = Stepping(1e-2, 4, 100.0)
    return Experiment(KNOWN, Motion("lab", t, x), (run,), RINGING, samples=samples)


@pytest.mark.parametrize("samples", ["point", "mean"])
def test_a_block_sees_of_the_model_what_it_holds_of_the_samples(samples: str) -> None:
    """Its middle alone is off by up to 2 nm in the ringing, and means are lower than points."""
    t = np.arange(0.0, 0.06, 1e-6)
    experiment = record(t, np.zeros_like(t), samples)
    fine = np.arange(0.0, 0.06, 1e-7)
    x, _ = experiment.simulate(KNOWN, np.array([1e-2]), fine)
    each = x.reshape(-1, 10)
    measured = each[:, 0]
    if samples == "mean":
        t, measured = t + 4.5e-7, each.mean(axis=1)
    trace = Trace(record(t, measured, samples))
    assert trace.blocks.count > 8
    seen = trace.model(KNOWN, np.zeros(2))
    plain, _ = experiment.simulate(KNOWN, np.array([1e-2]), trace.blocks.t)
    assert np.abs(plain - trace.blocks.x).max() > 2e-10
    assert np.abs(seen.x - trace.blocks.x).max() < 3e-11


def test_a_gap_is_filled_with_empty_blocks_and_a_spike_is_left_out() -> None:
    t = np.arange(0.0, 0.06, 1e-5)
    x = 1e-9 * np.random.default_rng(1).standard_normal(len(t))
    x[700] += 1e-6
    kept = (t < 0.02) | (t > 0.025)
    blocks = Blocks.of(record(t[kept], x[kept]))
    assert np.allclose(np.diff(blocks.t), 1e-5, atol=1e-6)
    assert (~blocks.full).sum() == pytest.approx(500, abs=2)
    assert blocks.count == 1
    assert np.abs(blocks.x).max() < 1e-8


def test_blocks_hold_one_number_of_samples_at_least_ten_a_swing() -> None:
    t = np.arange(0.0, 0.06, 1e-6)
    blocks = Blocks.of(record(t, np.zeros_like(t)))
    assert blocks.count == 10  # 6000 blocks at most, where a swing has enough
    assert len(blocks.t) == 6000
    thin = Blocks.of(record(t[::20], np.zeros(3000)))
    assert thin.count == 1


@pytest.mark.parametrize(
    ("white", "pink", "walk"), [(2e-9, 0.0, 0.0), (1e-9, 2e-9, 0.0), (1e-9, 0.0, 3e-8)]
)
def test_residuals_have_the_size_of_noise_of_any_colour(
    white: float, pink: float, walk: float
) -> None:
    """White residuals have a mean square of 1 in each part of the spectrum, hum and drift out."""
    random, count = np.random.default_rng(4), 6000
    t = 1e-5 * np.arange(count)
    spectrum = np.fft.rfft(random.standard_normal(count))
    spectrum[1:] /= np.sqrt(np.arange(1, len(spectrum)))
    coloured = np.fft.irfft(spectrum, count)
    x = white * random.standard_normal(count) + pink * coloured / np.std(coloured)
    x += walk * np.cumsum(random.standard_normal(count)) / np.sqrt(count)
    x += 3e-7 + 1e-6 * t + 8e-9 * np.sin(2.0 * np.pi * 50.0 * t + 1.0)
    trace = Trace(record(t, x))
    still = Seen(*np.zeros((3, count)))
    for _ in range(2):
        trace.learn(still)
    left = trace.residuals(still)[: 2 * (count // 2)].reshape(2, -1)
    for low, high, off in ((10, 100, 0.35), (100, 1000, 0.12), (1000, 3000, 0.08)):
        assert np.mean(left[:, low:high] ** 2) == pytest.approx(1.0, abs=off)
    assert trace.left(still).std() < 4.0 * (white + pink + walk)


def test_hum_that_stands_out_is_told_and_noise_is_not() -> None:
    random, t = np.random.default_rng(7), np.arange(0.0, 0.13, 2e-5)
    for mains in (50.0, 60.0):
        hum = 2e-8 * np.sin(2.0 * np.pi * mains * t + 1.0)
        trace = Trace(record(t, hum + 1e-9 * random.standard_normal(len(t))))
        still = Seen(*np.zeros((3, len(trace.blocks.t))))
        trace.learn(still)
        trace.learn(still)
        assert mains in trace.mains
        assert trace.left(still).std() == pytest.approx(1e-9, rel=0.1)
    plain = Trace(record(t, 1e-9 * random.standard_normal(len(t))))
    plain.learn(still)
    assert plain.mains == ()


def test_what_a_sensor_adds_moves_no_residual() -> None:
    """Zero, drift and hum, also of a frequency that is off by 0.05 Hz, are projected out."""
    known, motion = small()[1]
    trace = Trace(Experiment.of(known, motion))
    t = trace.blocks.t
    hum = 8e-9 * np.sin(2.0 * np.pi * 50.05 * t + 0.3)
    added = trace.white(2e-7 + 1e-6 * t + hum)
    assert float(added @ added) < 3.0
    bare = trace.transform(2e-7 + 1e-6 * t + hum)
    assert float(bare @ bare) > 1e4


@pytest.mark.parametrize("bandwidth", [6e4, 1e5])  # computed in full, and as delay and width
def test_the_width_of_an_instrument_is_as_its_low_pass(bandwidth: float) -> None:
    """A sensor of first order is late by its time constant, and as wide."""
    known, motion = small()[1]
    trace = Trace(Experiment.of(known, motion))
    time = 1.0 / (2.0 * np.pi * bandwidth)
    seen = trace.model(known.replace(sensor_bandwidth=bandwidth), np.zeros(2))
    late = np.array([1e6 * time, 0.0])
    wide, bare = trace.model(known, late, 1e12 * time**2), trace.model(known, late)
    off, without = (np.abs(seen.x - one.x)[5:-5] for one in (wide, bare))
    assert off.max() < 4e-10
    assert off.std() < 0.2 * without.std()


def test_empty_blocks_add_nothing() -> None:
    t = np.arange(0.0, 0.06, 1e-5)
    kept = (t < 0.02) | (t > 0.03)
    x = 1e-9 * np.random.default_rng(2).standard_normal(len(t))
    trace = Trace(record(t[kept], x[kept]))
    moved = trace.blocks.x.copy()
    moved[~trace.blocks.full] += 1e-6
    held = replace(trace.blocks, x=moved)
    before = trace.transform(trace.blocks.x)
    assert trace.transform(held.x) == pytest.approx(before)
