# SPDX-License-Identifier: Apache-2.0
"""Limits of the drive electronics: levels of the amplitude, steps a command, lowest frequency."""

import pytest
from table_1 import TABLE_1

from stickslip_ros.axis import Axis, CommandRefused
from stickslip_ros.parameters import ParameterError

MCS = {"max_voltage": 100.0, "amplitude": 100.0, "amplitude_levels": 4095}


def test_an_amplitude_is_rounded_to_the_levels_and_told_as_applied() -> None:
    axis = Axis({**TABLE_1, **MCS})
    level = 100.0 / 4095
    axis.command_amplitude(33.0)
    assert axis.status.amplitude == pytest.approx(1351 * level, rel=1e-12)
    axis.command_scan(33.0)
    axis.advance(1.0)
    assert axis.status.scan_level == pytest.approx(1351 * level, rel=1e-9)
    axis.command_amplitude(100.0)
    assert axis.status.amplitude == 100.0


def test_an_amplitude_that_rounds_to_nothing_is_refused() -> None:
    axis = Axis({**TABLE_1, **MCS})
    with pytest.raises(CommandRefused, match=r"0\.01 V, less than half a level"):
        axis.command_amplitude(0.01)
    assert axis.status.amplitude == 100.0


def test_the_amplitude_at_the_start_is_rounded_too() -> None:
    axis = Axis({**TABLE_1, **MCS, "amplitude": 50.01})
    assert axis.status.amplitude == pytest.approx(2048 * 100.0 / 4095)


def test_more_steps_than_a_command_may_have_are_refused() -> None:
    axis = Axis({**TABLE_1, "max_steps": 30_000})
    axis.command_steps(-30_000)
    with pytest.raises(CommandRefused, match="30001 steps; a command may have at most 30000"):
        axis.command_steps(30_001)
    axis.command_steps(0)


@pytest.mark.parametrize("command", ["command_frequency", "command_jog"])
def test_a_frequency_below_the_lowest_is_refused(command: str) -> None:
    axis = Axis({**TABLE_1, "min_frequency": 1.0})
    with pytest.raises(CommandRefused, match=r"0\.5 Hz; it has to lie between 1 and"):
        getattr(axis, command)(0.5)
    axis.command_frequency(1.0)


def test_a_runner_without_travel_makes_no_axis() -> None:
    with pytest.raises(ParameterError, match="travel_low and travel_high are 0 m; the runner"):
        Axis({**TABLE_1, "travel_low": 0.0, "travel_high": 0.0})
    assert Axis({**TABLE_1, "travel_low": 0.0}).state.x == 0.0


def test_settings_that_contradict_each_other_make_no_axis() -> None:
    for parameters, complaint in [
        ({"min_frequency": 200.0}, "frequency is 100 Hz"),
        ({"soft_low": 1e-3, "soft_high": 1e-3}, "soft_low is 0.001 m; it has to be less"),
        ({"amplitude_levels": 2, "amplitude": 10.0}, "less than half a level"),
    ]:
        with pytest.raises(ParameterError, match=complaint):
            Axis({**TABLE_1, **parameters})
        mutable = {name: value for name, value in parameters.items() if name != "amplitude"}
        axis = Axis({**TABLE_1, "amplitude": parameters.get("amplitude", 300.0)})
        if "amplitude" not in parameters:
            with pytest.raises(CommandRefused, match=complaint):
                axis.set_parameters(mutable)
