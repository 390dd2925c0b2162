# SPDX-License-Identifier: Apache-2.0
"""A small part of the study of intervals, `validation/campaigns/intervals.py`."""

import numpy as np
import pytest

from stickslip_ros.identification import identify
from validation.campaigns.intervals import experiment, judged, pulls

pytestmark = pytest.mark.slow


@pytest.mark.long
def test_intervals_of_experiments_by_lot_hold_the_truth() -> None:
    """Of eight intervals at 95 %, six or more do, but for one time in 170.

    The amplifier has no lag. Where it may have one, the fit ends at the bound of the lag, and all
    else has to follow as if the lag were not there: three of four were missed.
    """
    words: list[str] = []
    for seed, fit_lag in ((1004, False), (1005, None)):
        truth, runs = experiment(seed)
        found = identify(runs, fit_lag=fit_lag)
        words += judged(truth, found).values()
        for name, true in truth.items():
            assert found.parameters[name].value == pytest.approx(true, rel=0.1), name
    assert len(words) == 8
    assert words.count("held") >= 6


@pytest.mark.long
def test_hum_and_drift_do_not_pull_at_the_optimum() -> None:
    """In 1001 hum of 50 Hz in 28 ms was taken for 60 Hz: sigma_0ss was 17 % off, sigma_1 by 3.6."""
    found = np.array([pulls(seed) for seed in (1001, 2004, 2006, 2016)])
    assert np.abs(found).max() < 3.0
    assert np.mean(found**2) < 1.9  # 16 values of mean square 1: chance in a hundred


def test_an_experiment_repeats_and_its_start_is_wrong() -> None:
    truth, runs = experiment(1001)
    again = experiment(1001)[1]
    assert len(runs) == 3
    assert np.array_equal(runs[2][1].x, again[2][1].x)
    start = runs[0][0].flat()
    ratios = [float(start[name]) / true for name, true in truth.items()]
    assert all(1 / 3.01 < ratio < 3.01 for ratio in ratios)
    assert max(abs(ratio - 1.0) for ratio in ratios) > 0.3
