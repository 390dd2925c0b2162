# SPDX-License-Identifier: Apache-2.0
"""Names of a package that are loaded when they are first used: importing it costs nothing."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from typing import Any


def lazy_names(
    package: str, modules: Mapping[str, Sequence[str]], renamed: Mapping[str, str] | None = None
) -> Callable[[str], Any]:
    """Return the ``__getattr__`` of a package.

    modules: the names by the module below the package that each is loaded from. renamed: names of
    old, each with its new one; they work with a DeprecationWarning until version 1.0.0.
    """
    module_of = {name: module for module, names in modules.items() for name in names}
    old = renamed or {}

    def load(name: str) -> Any:
        if name in old:
            text = f"{package}.{name} is {old[name]} now; the old name goes with version 1.0.0"
            warnings.warn(text, DeprecationWarning, stacklevel=2)
            return load(old[name])
        if name in module_of:
            found = getattr(import_module(f"{package}.{module_of[name]}"), name)
            setattr(sys.modules[package], name, found)
            return found
        import difflib  # here, for whoever imports the package would load it otherwise

        near = [] if name.startswith("_") else difflib.get_close_matches(name, module_of, 3)
        hint = f"; did you mean {' or '.join(near)}?" if near else ""
        raise AttributeError(f"module {package!r} has no attribute {name!r}{hint}")

    return load
