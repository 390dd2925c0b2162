# SPDX-License-Identifier: Apache-2.0
"""The list of long studies: every command in it exists. None is run here."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

from validation.campaigns import interrupts
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
    name: str, compiled_solver: None, capsys: pytest.CaptureFixture[str]
) -> None:
    assert interrupts.study(name, moments=4, seed=7) == 0, capsys.readouterr().out
