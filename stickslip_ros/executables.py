# SPDX-License-Identifier: Apache-2.0
"""The executables of the nodes, and where the examples are.

A node takes a second to load, and Python ends with a traceback when a signal comes meanwhile. So
these functions import it only when SIGINT and SIGTERM already end the process with exit code 0.
"""

from __future__ import annotations

import os
import signal
import sys
import sysconfig
from importlib import import_module
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

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


def square() -> int:
    """Run the example that draws a square."""
    code: int = example("square").main(sys.argv)
    return code


def example(name: str) -> ModuleType:
    """Return the module of an example, such as square."""
    file = shared(f"examples/{name}.py")
    spec = spec_from_file_location(f"stickslip_example_{name}", file)
    assert spec and spec.loader
    module = module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def shared(name: str) -> Path:
    """Return a file beside the package, such as examples/square.py, or where it was installed."""
    beside = _PACKAGE.parent / name
    if beside.is_file():
        return beside
    # colcon and --prefix install data beside the lib folder that the package lies in.
    roots = [Path(sysconfig.get_path("data")), *_PACKAGE.parents]
    for root in roots:
        if (file := root / "share" / "stickslip_ros" / name).is_file():
            return file
    raise FileNotFoundError(f"no share/stickslip_ros/{name} below {', '.join(map(str, roots))}")


def _run(name: str) -> int:
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: os._exit(0))
    code: int = import_module(f"stickslip_ros.ros.{name}").main(sys.argv)
    return code
