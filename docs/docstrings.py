# SPDX-License-Identifier: Apache-2.0
"""Checks the docstrings of public names with numpydoc; the rules stand in pyproject.toml.

    python docs/docstrings.py

Checked are the functions in ``__all__`` of the rooms below; a room joins when its are done.
"""

from __future__ import annotations

import inspect
import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

from numpydoc.hooks.validate_docstrings import parse_config
from numpydoc.validate import validate

#: Rooms whose public functions have sections for parameters, results and errors.
ROOMS = ("simulation",)


def findings() -> Iterator[str]:
    """Yield what a docstring lacks, with the name and the number of the rule."""
    rules = parse_config(Path(__file__).parent.parent)["checks"]
    for room in ROOMS:
        module = import_module(f"stickslip_ros.{room}")
        for name in module.__all__:
            found = getattr(module, name)
            if inspect.isfunction(found):
                for code, text in validate(f"{found.__module__}.{name}")["errors"]:
                    if code in rules:
                        yield f"stickslip_ros.{room}.{name}: {code} {text}"


if __name__ == "__main__":
    sys.exit("\n".join(findings()) or 0)
