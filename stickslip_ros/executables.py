# SPDX-License-Identifier: Apache-2.0
"""The executables of the nodes, and where the examples are.

A node takes a second to load, and Python ends with a traceback when a signal comes meanwhile. So
these functions import it only when SIGINT and SIGTERM already end the process with exit code 0.
"""

from __future__ import annotations

import difflib
import os
import signal
import sys
import sysconfig
from importlib import import_module
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

from stickslip_ros.errors import StickslipError

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


def config_file(path: Path) -> Path:
    """Return a parameter file: the path, or the one of that name in ``config/`` of the package."""
    return _given_or_shared(path, "config/table1_typical.yaml", "parameter file")


def sample_file(path: Path) -> Path:
    """Return a measurement: the path, or the sample of that name that comes with the package."""
    return _given_or_shared(path, "examples/samples/steps_100hz.csv", "measurement")


def _given_or_shared(path: Path, one: str, what: str) -> Path:
    """Return path if it is there, else the file of that name beside one that we install."""
    if path.exists() or path.parent not in (Path(), Path(one).parent):
        return path
    try:
        folder = shared(one).parent
    except FileNotFoundError:
        return path
    if (folder / path.name).is_file():
        return folder / path.name
    known = [file.name for file in folder.iterdir() if file.suffix == Path(one).suffix]
    near = difflib.get_close_matches(path.name, known, 1)
    if near:
        raise StickslipError(f"there is no {what} {path}; did you mean {near[0]}?")
    return path


def _run(name: str) -> int:
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: os._exit(0))
    try:
        code: int = import_module(f"stickslip_ros.ros.{name}").main(sys.argv)
    except ModuleNotFoundError as error:
        if (error.name or "").startswith("stickslip_ros"):
            raise
        print(
            f"{name}: needs ROS 2, and {error.name} is missing: source a ROS, or "
            "pip install 'stickslip_ros[ros]' (in the checkout: '.[ros]')",
            file=sys.stderr,
        )
        return 2
    return code
