# SPDX-License-Identifier: Apache-2.0
"""Loads the public names of a package when they are first used, so that importing it is quick."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import cache
from importlib import import_module
from typing import Any

from stickslip_ros.errors import libraries_for


def lazy_names(package: str) -> Callable[[str], Any]:
    """Return the ``__getattr__`` of a package, which loads the names of its ``__all__``.

    The imports below ``if TYPE_CHECKING:`` say where from.
    """

    def load(name: str) -> Any:
        module = sys.modules[package]
        known = [] if name.startswith("_") else module.__all__
        if name in known:
            with libraries_for(f"{package}.{name}"):
                found = getattr(import_module(_modules(package)[name]), name)
            setattr(module, name, found)
            return found
        import difflib  # here, so that importing the package does not load it

        near = difflib.get_close_matches(name, known, 3)
        hint = f"; did you mean {' or '.join(near)}?" if near else ""
        raise AttributeError(f"module {package!r} has no attribute {name!r}{hint}")

    return load


@cache
def _modules(package: str) -> dict[str, str]:
    """Return the modules that a package imports names from for type checkers, by name."""
    import ast  # here, too
    import inspect

    found: dict[str, str] = {}
    for block in ast.parse(inspect.getsource(sys.modules[package])).body:
        if isinstance(block, ast.If) and ast.unparse(block.test) == "TYPE_CHECKING":
            for line in block.body:
                if isinstance(line, ast.ImportFrom) and line.module:
                    names = [one.name for one in line.names]
                    names = import_module(line.module).__all__ if names == ["*"] else names
                    found |= dict.fromkeys(names, line.module)
    return found
