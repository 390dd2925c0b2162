# SPDX-License-Identifier: Apache-2.0
"""Starts the nodes; also as ``python -m stickslip_ros.executables axis_node``.

A node takes a second to load, and Python ends with a traceback when a signal comes meanwhile. So
these functions import it only when signals already end the process with exit code 0.
"""

from __future__ import annotations

import os
import signal
import sys
from importlib import import_module

from stickslip_ros.base.errors import end_process, ending_signals
from stickslip_ros.base.shared_files import example


def axis_node() -> int:
    """Run the node of an axis, or of several."""
    return _run("axis_node", "axis_host")


def recorder_node() -> int:
    """Run the recorder."""
    return _run("recorder_node", "recorder_node")


def replay_node() -> int:
    """Run the node that plays a bag."""
    return _run("replay_node", "replay_node")


def twin_node() -> int:
    """Run the twin of an axis."""
    return _run("twin_node", "twin_node")


def square() -> int:
    """Run the example that draws a square."""
    return example("square").main(sys.argv)


def _run(name: str, module: str) -> int:
    for number in ending_signals():
        signal.signal(number, lambda *_: os._exit(0))
    try:
        code: int = import_module(f"stickslip_ros.ros.nodes.{module}").main(sys.argv)
    except ModuleNotFoundError as error:
        if (error.name or "").startswith("stickslip_ros"):
            raise
        print(
            f"{name}: needs ROS 2, and {error.name} is missing: source a ROS, or "
            "pip install 'stickslip_ros[ros]' (in the checkout: '.[ros]')",
            file=sys.stderr,
        )
        return 2
    return end_process(code)


if __name__ == "__main__":
    nodes = {each.__name__: each for each in (axis_node, recorder_node, replay_node, twin_node)}
    if len(sys.argv) < 2 or sys.argv[1] not in nodes:
        sys.exit(f"usage: python -m stickslip_ros.executables {{{','.join(nodes)}}} [ARGUMENTS]")
    sys.argv.pop(0)
    sys.exit(nodes[sys.argv[0]]())
