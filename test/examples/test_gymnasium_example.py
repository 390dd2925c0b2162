# SPDX-License-Identifier: Apache-2.0
"""The example of an environment, by Gymnasium's own checker."""

import runpy

import pytest

from stickslip_ros.base.shared_files import shared

pytest.importorskip("gymnasium")
EXAMPLE = str(shared("examples/gymnasium_env.py"))


def test_the_environment_is_one_for_gymnasium() -> None:
    from gymnasium.utils.env_checker import check_env

    check_env(runpy.run_path(EXAMPLE)["Positioning"](), skip_render_check=True)


def test_a_simple_rule_reaches_the_target(capsys: pytest.CaptureFixture[str]) -> None:
    runpy.run_path(EXAMPLE, run_name="__main__")
    last = capsys.readouterr().out.splitlines()[-1]
    assert abs(float(last.split()[0])) < 10.0
