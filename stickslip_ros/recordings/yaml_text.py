# SPDX-License-Identifier: Apache-2.0
"""YAML from strangers: bounded in size and depth, every scalar a text."""

from __future__ import annotations

from typing import Any

import yaml

# The ones in C are ten times as fast; they are missing where PyYAML was built without libyaml.
_Loader = getattr(yaml, "CBaseLoader", yaml.BaseLoader)

_LARGEST = 1024 * 1024  # characters; a thousand topics with their QoS take half of it
_DEEPEST = 20
_NOTHING = ("", "~", "null")


def load_texts(text: str) -> Any:
    """Return lists and dictionaries of texts; nothing is taken for a number or a date.

    :raises ValueError: not YAML, or such that loading it would take much time or memory.
    """
    if len(text) > _LARGEST:
        raise ValueError(f"{len(text)} characters of YAML; at most {_LARGEST} are taken")
    try:
        _refuse_traps(text)
        return yaml.load(text, Loader=_Loader)
    except yaml.YAMLError as error:
        raise ValueError(f"not YAML ({' '.join(str(error).split())})") from None


def _refuse_traps(text: str) -> None:
    """Deep nesting overflows the stack; aliases can make a short text very long."""
    sizes: dict[str | None, int] = {}  # of the values with an anchor, in scalars
    inside: list[tuple[str | None, int]] = []  # anchor of each open collection, size before it
    size = 0
    for event in yaml.parse(text, Loader=_Loader):
        if isinstance(event, yaml.AliasEvent):
            if event.anchor not in sizes:
                raise ValueError("YAML with a value inside itself, or an unknown alias")
            size += sizes[event.anchor]
        elif isinstance(event, yaml.CollectionStartEvent):
            inside.append((event.anchor, size))
            size += 1
            if len(inside) > _DEEPEST:
                raise ValueError(f"YAML nested more than {_DEEPEST} deep")
        elif isinstance(event, yaml.CollectionEndEvent):
            anchor, before = inside.pop()
            sizes[anchor] = size - before
        elif isinstance(event, yaml.ScalarEvent):
            size += 1
            sizes[event.anchor] = 1
        if size > _LARGEST:
            raise ValueError(f"YAML that is too long: more than {_LARGEST} values")


def mapping(value: Any, what: str) -> dict[str, Any]:
    """Return a value that has to be a mapping with texts as keys; ValueError if it is not.

    Nothing at all is an empty one, as rosbag2 writes it.
    """
    if isinstance(value, str) and value in _NOTHING:
        return {}
    if not isinstance(value, dict) or not all(isinstance(key, str) for key in value):
        raise ValueError(f"{what} has to be a mapping")
    return value


def sequence(value: Any, what: str) -> list[Any]:
    """Return a value that has to be a list, nothing at all being an empty one; or ValueError."""
    if isinstance(value, str) and value in _NOTHING:
        return []
    if not isinstance(value, list):
        raise ValueError(f"{what} has to be a list")
    return value


def text_of(value: Any, what: str) -> str:
    """Return a value that has to be a scalar; ValueError if it is not."""
    if not isinstance(value, str):
        raise ValueError(f"{what} has to be a single value")
    return value


def integer(value: Any, what: str) -> int:
    """Return a value that has to be a whole number of 64 bits; ValueError if it is not."""
    text = text_of(value, what)
    try:
        number = int(text) if len(text) < 30 else None
    except ValueError:
        number = None
    if number is None or not -(2**63) <= number < 2**64:
        raise ValueError(f"{what} is {text[:30]!r}; it has to be a whole number of 64 bits")
    return number
