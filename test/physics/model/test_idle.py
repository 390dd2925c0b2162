# SPDX-License-Identifier: Apache-2.0
"""Settings that do nothing are named, and none that does something."""

from pathlib import Path
from typing import Any

import pytest

from stickslip_ros.base.shared_files import config_file
from stickslip_ros.cli.main import main
from stickslip_ros.physics.model.idle import idle_settings
from stickslip_ros.physics.parameters import PARAMETERS, Parameters


def said(**values: Any) -> str:
    return idle_settings(Parameters.of(values), values)


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"hysteresis": 0.2}, "hysteresis: set actuator to hysteresis, it is linear"),
        ({"actuator_memory": True}, "actuator_memory: set actuator to hysteresis, it is linear"),
        ({"model": "lugre", "z_ss": 1e-7, "z_ba": 1e-8},
         "z_ba, z_ss: the law lugre does not use it"),
        ({"d_c": 2e-8}, "d_c: the law ceim does not use it"),
        ({"split": 0.3}, "split: the waveform sawtooth does not use it"),
        ({"z_ba": 5e-8, "z_ba_slope": 3e-8}, "z_ba_slope: z_ba is set, which replaces it"),
    ],
)  # fmt: skip
def test_a_setting_without_effect_is_named(values: dict[str, Any], text: str) -> None:
    assert said(**values) == f"without effect: {text}"


@pytest.mark.parametrize(
    "values",
    [
        {},
        {"hysteresis": PARAMETERS["hysteresis"].default},
        {"hysteresis": 0.2, "actuator": "hysteresis"},
        {"z_ss": 1.5e-7},
        {"d_c": 2e-8, "model": "ceim_ageing"},
        {"split": 0.3, "waveform": "shaped", "hold_before": 0.1},
    ],
)
def test_a_setting_with_an_effect_is_not(values: dict[str, Any]) -> None:
    assert said(**values) == ""


def test_a_snapshot_holds_what_is_not_in_use_as_well() -> None:
    p = Parameters.of(hysteresis=0.2, d_c=2e-8)
    assert idle_settings(p, p.flat()) == ""


@pytest.mark.parametrize(
    "file", sorted(Path(config_file(Path("table1_typical"))).parent.glob("*.yaml"))
)
def test_files_of_ours_hold_no_idle_settings(file: Path) -> None:
    p = Parameters.of(file)
    changed = [name for name, value in p.flat().items() if value != Parameters().flat()[name]]
    assert idle_settings(p, changed) == ""


def test_a_law_that_is_not_known_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    """It ended in a KeyError before the error that names what is known."""
    assert main(["simulate", "--steps", "1", "--set", "model=coulomb"]) == 2
    assert "model is 'coulomb'; known: ceim" in capsys.readouterr().err


def test_a_command_says_it_once(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["predict", "--set", "hysteresis=0.2"]) == 0
    assert capsys.readouterr().err.count("without effect: hysteresis") == 1
