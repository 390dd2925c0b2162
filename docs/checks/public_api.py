# SPDX-License-Identifier: Apache-2.0
"""The public names with their signatures, and a record of them; run it to renew the record."""

import importlib
import inspect
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
RECORD = Path(__file__).with_suffix(".txt")


#: What is promised beside the names of the package, as docs/library.md says.
PROMISED = ["client"]


def _parameters(function: Any) -> str:
    """Return the parameters of a function as they are written in a call; annotations may change."""
    try:
        found = list(inspect.signature(function).parameters.values())
    except (TypeError, ValueError):
        return ""
    words: list[str] = []
    for one in found:
        stars = "*" * ((one.kind == one.VAR_POSITIONAL) + 2 * (one.kind == one.VAR_KEYWORD))
        if one.kind == one.KEYWORD_ONLY and not any(word.startswith("*") for word in words):
            words.append("*")
        plain = one.default is None or isinstance(one.default, int | float | str)
        default = f"={one.default!r}" if plain else "=..."
        words.append(stars + one.name + ("" if one.default is one.empty else default))
    return f"({', '.join(words)})"


def _lines(name: str, found: Any) -> list[str]:
    """Return what is recorded of a name: itself and, of a class, its public members."""
    if not inspect.isclass(found):
        return [name + (_parameters(found) if inspect.isroutine(found) else "")]
    members = sorted(
        (key, value)
        for base in found.__mro__
        if base.__module__.startswith("stickslip_ros")
        for key, value in vars(base).items()
        if not key.startswith("_")
    )
    lines = [name + _parameters(found)]
    for key, value in dict(members).items():
        called = inspect.isroutine(value) or isinstance(value, classmethod | staticmethod)
        lines.append(f"{name}.{key}" + (_parameters(getattr(found, key)) if called else ""))
    return lines


def surface() -> list[str]:
    """Return a line for each public name of the package and of the client, with its parameters.

    What the package itself offers is only named where the client offers it, too.
    """
    lines: list[str] = []
    seen: set[int] = set()
    for room in ["", *PROMISED]:
        module = importlib.import_module(f"stickslip_ros.{room}".rstrip("."))
        for name in sorted(set(module.__all__)):
            found = getattr(module, name)
            lines += [f"{room}:{name}"] if id(found) in seen else _lines(f"{room}:{name}", found)
            seen.add(id(found))
    return lines


if __name__ == "__main__":
    RECORD.write_text("\n".join([*surface(), ""]), encoding="utf-8")
