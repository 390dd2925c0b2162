# SPDX-License-Identifier: Apache-2.0
"""The executables of the nodes, and where the examples are.

A node takes a second to load, and Python ends with a traceback when a signal comes meanwhile. So
these functions import it only when SIGINT and SIGTERM already end the process with exit code 0.
"""

from __future__ import annotations

import os
import runpy
import signal
import sys
import sysconfig
from importlib import import_module
from pathlib import Path

_PACKAGE = Path(__file__).parent


def axis_node() -> int:
    """Run the node of an axis, or of several."""
    return _run("axis_node")


def recorder_node() -> int:
    """Run the recorder."""
    return _run("recorder_node")


def replay_node() -> int:
    """Run the node that plays a bag."""
    return _run("replay_node")


def square() -> None:
    """Run the example that draws a square."""
    runpy.run_path(str(example("square")), run_name="__main__")


def example(name: str) -> Path:
    """Return the file of an example: beside the package, or where it was installed."""
    beside = _PACKAGE.parent / "examples" / f"{name}.py"
    if beside.is_file():
        return beside
    share = Path("share", "stickslip_ros", "examples", beside.name)
    # colcon and --prefix install data beside the lib folder that the package lies in.
    roots = [Path(sysconfig.get_path("data")), *_PACKAGE.parents]
    found = [root / share for root in roots if (root / share).is_file()]
    if not found:
        raise FileNotFoundError(f"no {share} below any of {', '.join(map(str, roots))}")
    return found[0]


def _run(name: str) -> int:
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: os._exit(0))
    code: int = import_module(f"stickslip_ros.ros.{name}").main(sys.argv)
    return code
