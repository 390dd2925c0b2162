# SPDX-License-Identifier: Apache-2.0
"""Loads the public names of a package when they are first used, so that importing it is quick."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

from stickslip_ros.base.errors import libraries_for


def lazy_names(package: str, places: Mapping[str, str]) -> Callable[[str], Any]:
    """Return the ``__getattr__`` (PEP 562) of a package.

    places names the modules below the package, each with the names that it defines, in one text.
    """
    modules = {name: module for module, names in places.items() for name in names.split()}

    def load(name: str) -> Any:
        if name in modules:
            with libraries_for(f"{package}.{name}"):
                found = getattr(import_module(f"{package}.{modules[name]}"), name)
            setattr(sys.modules[package], name, found)
            return found
        import difflib  # here, so that importing the package does not load it

        near = difflib.get_close_matches(name, modules, 3) if name[:1] != "_" else []
        hint = f"; did you mean {' or '.join(near)}?" if near else ""
        raise AttributeError(f"module {package!r} has no attribute {name!r}{hint}")

    return load
