# SPDX-License-Identifier: Apache-2.0
"""The list of long studies: every command in it exists. None is run here."""

import importlib.util
from pathlib import Path

import pytest

from stickslip_ros.traces import run_steps
from validation.campaigns import interrupts, parameter_sets, targets
from validation.campaigns.__main__ import CAMPAIGNS, main

ROOT = Path(__file__).resolve().parents[2]


def test_every_campaign_is_a_module_or_tests_that_read_its_variables() -> None:
    for name, campaign in CAMPAIGNS.items():
        module, *arguments = campaign.command
        assert importlib.util.find_spec(module), name
        for variable in campaign.environment:
            tests = ROOT / arguments[-1]
            files = tests.rglob("*.py") if tests.is_dir() else [tests]
            assert any(variable in file.read_text("utf-8") for file in files), name


def test_an_unknown_campaign_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main(["fizz"])
    assert end.value.code == 2
    assert "there is no campaign 'fizz'; known: accuracy, " in capsys.readouterr().err


@pytest.mark.parametrize("name", ["guide", "bag export", "emulate"])
def test_ctrl_c_ends_a_command_soon_and_leaves_nothing_half(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert interrupts.study(name, moments=2, seed=7) == 0, capsys.readouterr().out


def test_sets_over_all_ranges_give_a_result_or_a_word() -> None:
    """The last one was never done: its slew limit lies far below what the drive asks for."""
    run_steps({"creep": 0.01, "dwell_growth": 0.02, "surface_spread": 0.1}, 3)  # compiled by that
    for number in (*range(20), 1489):
        values = parameter_sets.drawn(number)
        assert parameter_sets.judged(values) in ("result", "refused", "budget"), values


@pytest.mark.slow
def test_targets_are_reached_or_given_up(capsys: pytest.CaptureFixture[str]) -> None:
    """Of them a load carries two away for ever, and one is reached where no scan corrects it."""
    for seed, number in (("1", "16"), ("1", "27"), ("777001", "61082")):
        one = ["--count", "1", "--seed", seed, "--first", number]
        assert targets.main(one) == 0, capsys.readouterr().out
    assert targets.main(["--count", "3", "--seed", "2"]) == 0, capsys.readouterr().out


@pytest.mark.long
def test_an_axis_hears_stops_and_signals_at_any_cost(ros_domain: int) -> None:
    pytest.importorskip("rclpy")
    from validation.campaigns import overload

    assert overload.study(2, seed=3).faults == []


@pytest.mark.parametrize("moments", [1, pytest.param(12, marks=pytest.mark.long)])
def test_ends_of_recorders_and_axes_lose_no_more_than_is_said(
    ros_domain: int, capsys: pytest.CaptureFixture[str], moments: int
) -> None:
    pytest.importorskip("rclpy")
    from validation.campaigns import endings

    assert endings.study(moments, seed=1) == 0, capsys.readouterr().out
