# SPDX-License-Identifier: Apache-2.0
"""``stickslip warm-up``: afterwards nothing is compiled any more."""

import os
import subprocess
from pathlib import Path

import pytest
from child import python

#: What a first user does; each in a process of its own.
LATER = (
    "simulate --steps 5 --set model=lugre",
    "simulate --steps 5 --set actuator_resonance=8e5",
    "simulate --steps 5 --config edeler_2011_everything",
    "simulate --steps 5 --frequency 10000 --trace run.csv",
    "sweep --vary preload=0.3:6:3 --metric blocking_preload --metric generated_force",
    "elongate --set frequency=10000",
    "analyse run.csv",
)
AXIS = """
from stickslip_ros import Axis
axis = Axis({"frequency": 1000.0})
for command, value in (("steps", 3), ("jog", -500.0), ("scan", 10.0), ("position", 1e-7)):
    axis.command(command, value)
    axis.advance(axis.state.t + 0.02)
"""


@pytest.mark.skipif(
    "STICKSLIP_WARM_UP" not in os.environ, reason="compiles all anew: set STICKSLIP_WARM_UP=1"
)
def test_nothing_is_compiled_after_it(tmp_path: Path) -> None:
    """In a folder of its own for the cache, so a minute of compiling comes first."""

    def run(*arguments: str) -> subprocess.CompletedProcess[str]:
        cache = {"NUMBA_CACHE_DIR": str(tmp_path / "cache"), "NUMBA_DISABLE_JIT": "0"}
        return python(*arguments, cwd=tmp_path, **cache)

    first = run("-m", "stickslip_ros", "warm-up")
    assert "compiling the solver" in first.stderr
    assert first.stdout.startswith("ready after")
    for command in LATER:
        assert run("-m", "stickslip_ros", *command.split()).stderr == ""
    tell = "from stickslip_ros.base.compiled import report_compilation as t\nwith t():\n"
    assert run("-c", tell + AXIS.strip().replace("\n", "\n    ").join(["    ", "\n"])).stderr == ""
