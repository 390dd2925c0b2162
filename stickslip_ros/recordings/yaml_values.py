# SPDX-License-Identifier: Apache-2.0
"""What a value of a ``metadata.yaml`` has to be: mapping, list, text or whole number."""

from __future__ import annotations

from typing import Any

_NOTHING = ("", "~", "null")


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
