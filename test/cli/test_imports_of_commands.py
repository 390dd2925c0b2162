# SPDX-License-Identifier: Apache-2.0
"""What the commands load, which is what they take to start; times depend on the machine."""

import subprocess

import pytest
from child import python

#: A tenth of a second to load and more, each.
HEAVY = {"numpy", "scipy", "numba", "matplotlib", "jinja2", "mcap", "rclpy", "tqdm", "rich"}

_EVERY_HELP = """
import argparse, sys
from stickslip_ros.cli.command_line import parser_for

def show(parser):
    shown = [parser.format_help()]
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            shown += [text for inner in action.choices.values() for text in show(inner)]
    return shown

assert len(show(parser_for())) > 20
print(*sys.modules)
"""
_SIMULATE = """
import sys
from stickslip_ros.cli.main import main
main(["simulate", "--steps", "2", "--json"])
print(*sys.modules, file=sys.stderr)
"""


def _run(code: str) -> subprocess.CompletedProcess[str]:
    return python("-c", code)


def test_no_help_loads_what_computes() -> None:
    run = _run(_EVERY_HELP)
    assert run.returncode == 0, run.stderr
    assert not HEAVY & set(run.stdout.split())


@pytest.mark.long
def test_a_compiled_run_loads_no_compiler_and_nothing_of_scipy() -> None:
    """Each of these takes a tenth to half a second."""
    _run(_SIMULATE)  # so that it is compiled
    modules = set(_run(_SIMULATE).stderr.split())
    assert "numba" in modules
    slow = {"scipy.linalg", "scipy.optimize", "scipy.interpolate", "numba.np.linalg", "matplotlib"}
    assert not slow & modules


@pytest.mark.parametrize(
    "code",
    [
        "from stickslip_ros.cli.main import main; main(['analyse', 'steps_100hz.csv'])",
        "import stickslip_ros.client",
        "from stickslip_ros.axis.commands import COMMANDS",
    ],
    ids=["analyse", "client", "commands"],
)
def test_who_computes_no_motion_loads_no_solver(code: str) -> None:
    run = _run(f"import sys\n{code}\nprint(*sys.modules, file=sys.stderr)")
    modules = set(run.stderr.split())
    if "client" in code and "rclpy" not in modules:
        pytest.skip("needs rclpy")
    assert "numpy" in modules or "COMMANDS" in code, run.stderr
    assert not {"numba", "stickslip_ros.physics.solver", "stickslip_ros.base.compiled"} & modules
