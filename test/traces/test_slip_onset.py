# SPDX-License-Identifier: Apache-2.0
"""When slips begin, of motions drawn from the answer of a runner that rings."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stickslip_ros.traces.ringing import Ringing
from stickslip_ros.traces.slip_onset import PUSH, find_onset, some_cycles

PERIOD, RINGING = 1e-2, Ringing(frequency=7500.0, decay=600.0)


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
    few_t, few_x = some_cycles(t, x, slips, PERIOD)
    assert len(few_t) <= 40_000
    onset = find_onset(few_t, few_x, slips, PERIOD, RINGING)
    assert onset.shift == pytest.approx(late, abs=1e-6)
    assert onset.shift_error < 1e-6
