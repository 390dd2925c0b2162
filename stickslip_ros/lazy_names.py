# SPDX-License-Identifier: Apache-2.0
"""Loads the public names of a package when they are first used, so that importing it is quick."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from typing import Any

from stickslip_ros.errors import libraries_for


def lazy_names(
    package: str, modules: Mapping[str, Sequence[str]], renamed: Mapping[str, str] | None = None
) -> Callable[[str], Any]:
    """Return the ``__getattr__`` of a package.

    modules: names by the module of the package that defines them. renamed: old names with their new
    ones; old names work with a DeprecationWarning until version 1.0.0.
    """
    module_of = {name: module for module, names in modules.items() for name in names}
    old = renamed or {}

    def load(name: str) -> Any:
        if name in old:
            text = f"{package}.{name} is {old[name]} now; the old name goes with version 1.0.0"
            warnings.warn(text, DeprecationWarning, stacklevel=2)
            return load(old[name])
        if name in module_of:
            with libraries_for(f"{package}.{name}"):
                found = getattr(import_module(f"{package}.{module_of[name]}"), name)
            setattr(sys.modules[package], name, found)
            return found
        import difflib  # here, so that importing the package does not load it

        near = [] if name.startswith("_") else difflib.get_close_matches(name, module_of, 3)
        hint = f"; did you mean {' or '.join(near)}?" if near else ""
        raise AttributeError(f"module {package!r} has no attribute {name!r}{hint}")

    return load
