# SPDX-License-Identifier: Apache-2.0
"""The pytest plugin, in another project; what its fixtures give is shown by journey 1."""

import os
import subprocess
from collections.abc import Sequence
from pathlib import Path

from child import python

PLUGIN = "stickslip_ros.testing"


def run_pytest(folder: Path, arguments: Sequence[str]) -> subprocess.CompletedProcess[str]:
    """Run pytest on a folder, with the plugin whether or not the package is installed."""
    own = {name: "" for name in os.environ if name.startswith("PYTEST_")}
    options = ("-p", PLUGIN, "-p", "no:cacheprovider")
    return python("-m", "pytest", *options, *arguments, cwd=folder, **own)


def test_a_mistake_in_the_marker_is_told(tmp_path: Path) -> None:
    (tmp_path / "test_stage.py").write_text(
        "import pytest\n"
        "@pytest.mark.stickslip(prelaod=1.0)\ndef test_one(offline_axis): ...\n"
        "@pytest.mark.stickslip(1.0)\ndef test_two(offline_axis): ...\n"
    )
    found = run_pytest(tmp_path, [])
    assert found.returncode == 1
    assert "@pytest.mark.stickslip: there is no parameter 'prelaod'; did you mean" in found.stdout
    assert "takes names only" in found.stdout
    assert "plugin.py" not in found.stdout  # a line each, and no traceback


def test_loading_the_plugin_loads_nothing_else() -> None:
    program = (
        f"import sys, pytest; before = set(sys.modules); import {PLUGIN}; "
        "print(*sorted(name for name in set(sys.modules) - before))"
    )
    found = python("-c", program)
    assert {name.partition(".")[0] for name in found.stdout.split()} <= {"stickslip_ros"}
