# SPDX-License-Identifier: Apache-2.0
"""Finds the files of the package besides its code: examples, samples, parameter files."""

from __future__ import annotations

import difflib
import sys
import sysconfig
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

from stickslip_ros.base.errors import StickslipError

_PACKAGE = Path(__file__).parents[1]


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


def config_file(path: Path, error: type[StickslipError] = StickslipError) -> Path:
    """Return a parameter file: the path, or the one of that name in ``config/`` of the package."""
    return _given_or_shared(path, "config/table1_typical.yaml", "parameter file", error)


def sample_file(path: Path, error: type[StickslipError] = StickslipError) -> Path:
    """Return a measurement: the path, or the sample of that name that comes with the package."""
    return _given_or_shared(path, "examples/samples/steps_100hz.csv", "measurement", error)


def _given_or_shared(path: Path, one: str, what: str, error: type[StickslipError]) -> Path:
    """Return path if it is there, else the file of that name beside one that we install.

    The name needs no ending. Raises the error for a name that no such file has.
    """
    if path.exists() or path.parent not in (Path(), Path(one).parent):
        return path
    try:
        folder = shared(one).parent
    except FileNotFoundError:
        return path
    for name in (path.name, path.name + Path(one).suffix):
        if (folder / name).is_file():
            return folder / name
    files = [file for file in folder.iterdir() if file.suffix == Path(one).suffix]
    known = [file.name if path.suffix else file.stem for file in files]
    near = difflib.get_close_matches(path.name, known, 1)
    if near:
        raise error(f"there is no {what} {path}; did you mean {near[0]}?")
    if not path.suffix:  # a name and no file
        raise error(f"there is no {what} {path}; here are {', '.join(sorted(known))}")
    return path
