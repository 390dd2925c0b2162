# SPDX-License-Identifier: Apache-2.0
"""The bound on false alarms, and what the detector says of changes."""

import numpy as np
from scipy.stats import poisson

from stickslip_ros.measurement.twin.changes import ChangeDetector


def test_mean_time_to_a_false_alarm_is_the_one_set_or_longer() -> None:
    """Upper 95 % bound of the rate over 200 runs as long as the interval, each begun anew."""
    interval, readings = 20.0, 400
    random = np.random.default_rng(5)
    alarms = 0
    for _ in range(200):
        detector = ChangeDetector(interval)
        for k in range(readings):
            if detector.update(0.05 * k, interval / readings, float(random.standard_normal())):
                alarms += 1
                detector.reset()
    # 95 % bound of the expectation of a Poisson count
    expected = np.linspace(0.0, 400.0, 4001)
    upper = expected[poisson.cdf(alarms, expected) > 0.05][-1]
    assert alarms > 10
    assert upper < 200.0


def test_a_shift_is_told_soon_with_its_onset() -> None:
    random = np.random.default_rng(3)
    detector = ChangeDetector(86_400.0)
    told = None
    for k in range(1500):
        if detector.update(0.01 * k, 0.01, float(random.standard_normal()) + 2.0 * (k >= 1000)):
            told = k
            break
    assert told is not None and 1000 <= told < 1020
    assert abs(detector.onset - 10.0) < 0.06


def test_two_glitches_are_no_change() -> None:
    detector = ChangeDetector(3600.0)
    for k in range(2000):
        assert not detector.update(0.01 * k, 0.01, 1e9 if k in (1500, 1501) else 0.0)
