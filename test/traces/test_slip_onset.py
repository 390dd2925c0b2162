# SPDX-License-Identifier: Apache-2.0
"""When slips begin, of motions drawn from the answer of a runner that rings."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from stickslip_ros.traces.ringing import PUSH, Ringing, find_onset, thin_samples

Array = NDArray[np.float64]
PERIOD, RINGING = 1e-2, Ringing(frequency=7500.0, decay=600.0)


@pytest.mark.slow
@pytest.mark.parametrize(("cycles", "rate"), [(2, 2e5), (9, 2e5), (9, 5e6), (40, 2e5)])
def test_cycles_of_many_samples_show_when_slips_begin(cycles: int, rate: float) -> None:
    """However many samples a few cycles have, slips stay among those that are looked at."""
    late = 3e-6
    t = np.arange(0.0, (cycles + 1) * PERIOD, 1.0 / rate)
    slips = PERIOD * np.arange(1.0, cycles + 1.0)
    x = np.zeros_like(t)
    for slip in slips:
        after = np.maximum(t - slip - late, 0.0)
        phase = 2.0 * math.pi * RINGING.frequency * after
        push = PUSH * RINGING.decay / (2.0 * math.pi * RINGING.frequency)
        swing = np.exp(-RINGING.decay * after) * (np.cos(phase) - push * np.sin(phase))
        x -= 30e-9 * (t > slip + late) * (1.0 - swing)
    x += 160e-9 * t / PERIOD + np.random.default_rng(3).normal(0.0, 1e-9, len(t))
    few_t, few_x = thin_samples(t, x, slips, PERIOD)
    assert min(len(t), 5_000) <= len(few_t) <= 40_000
    onset = find_onset(few_t, few_x, slips, PERIOD, RINGING)
    assert onset.shift == pytest.approx(late, abs=1e-6)
    assert onset.shift_error < 1e-6


@pytest.mark.parametrize("drift", [0.0, 4e-4, -4e-4])
def test_slips_of_a_wrong_clock_drift(drift: float) -> None:
    """Slips that come 4 us later in each cycle, from the middle on, as a clock off by 4e-4 has."""
    t: Array = np.arange(0.0, 0.13, 5e-6)
    slips: Array = PERIOD * np.arange(1.0, 12.0)
    middle = float(slips[3])
    omega = 2.0 * math.pi * RINGING.frequency
    x: Array = 1e-5 * t
    for slip in slips:
        after = np.maximum(t - slip - 2e-6 - drift * (slip - middle), 0.0)
        cosine, sine = RINGING.columns(after).T
        x -= 3e-8 * (after > 0.0) * (1.0 - cosine + PUSH * RINGING.decay / omega * sine)
    x += np.random.default_rng(5).normal(0.0, 1e-10, len(t))
    onset = find_onset(t, x, slips, PERIOD, RINGING, drift=True, middle=middle)
    assert onset.drift == pytest.approx(drift, abs=1e-5)
    assert onset.shift == pytest.approx(2e-6, abs=1e-6)
    assert onset.shift_error < 2e-7
