# SPDX-License-Identifier: Apache-2.0
"""The sawtooth of four parameters and what contradicts it."""

import numpy as np
import pytest
from table_1 import table_1

from stickslip_ros.model import Plant, drive_of, sawtooth
from stickslip_ros.parameters import ParameterError


@pytest.mark.parametrize("sign", [1, -1])
def test_sawtooth(sign: int) -> None:
    """Rise in 1/f - V/slew, fall in V/slew, 160 nm at 300 V; u ends where it began."""
    drive_cycle = sawtooth(300.0, 100.0, 100.0, 160e-9 / 300.0, sign)
    np.testing.assert_allclose(drive_cycle.durations, [10e-3 - 3e-6, 3e-6])
    strokes = drive_cycle.durations * drive_cycle.rates
    np.testing.assert_allclose(strokes, [sign * 160e-9, -sign * 160e-9])
    assert drive_cycle.period == pytest.approx(10e-3)
    assert strokes.sum() == pytest.approx(0.0, abs=1e-22)


def test_no_time_for_the_slip() -> None:
    """3 us of slip do not fit into 400 kHz; the message says what would."""
    with pytest.raises(ParameterError, match=r"2\.5 us a cycle.*takes 3 us.*below 333333 Hz"):
        sawtooth(300.0, 4e5, 100.0, 5e-10)


def test_limits_of_the_amplifier() -> None:
    """max_voltage and max_frequency bound the drive."""
    for values, words in [
        ({"amplitude": 301.0}, "amplitude is 301 V; it has to lie between 1e-09 and 300 V"),
        ({"frequency": 2e5}, "frequency is 200000 Hz; it has to lie between 1e-06 and 100000 Hz"),
    ]:
        with pytest.raises(ParameterError, match=words):
            drive_of(table_1(**values))


def test_gravity_and_payload() -> None:
    """Up the hill gravity pulls back, on the runner and what it carries."""
    plant = Plant.of(table_1(inclination=np.pi / 2, payload=1e-3, force=0.01))
    assert plant.mass == pytest.approx(5e-3)
    assert plant.force == pytest.approx(0.01 - 5e-3 * 9.80665)


def test_a_slack_spring_is_none() -> None:
    """Softer than a real sensor ever is, it would only cost accuracy."""
    assert Plant.of(table_1(spring=3.9e-200)).spring == 0.0
    assert Plant.of(table_1(spring=1e-3)).spring == 1e-3
