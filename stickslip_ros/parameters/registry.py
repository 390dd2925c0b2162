# SPDX-License-Identifier: Apache-2.0
"""Rows that others bring into the one table: a friction law or a waveform, its own constants.

What brings rows is a frozen dataclass of fields made by `row.number`, `row.text` or `row.switch`.
This room imports none of those that register: the package does, when it is first imported.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, TypeVar

Rows = TypeVar("Rows")

_REGISTERED: dict[str, list[type]] = {"friction": [], "drive": []}


def register(group: str, rows: type) -> None:
    """Add the rows of a dataclass to the group "friction" or "drive" of the table."""
    if rows not in _REGISTERED[group]:
        _REGISTERED[group].append(rows)


def registered_rows(group: str) -> tuple[type, ...]:
    """Return the dataclasses that are registered in a group, in their order."""
    return tuple(_REGISTERED.get(group, ()))


@dataclass(frozen=True)
class Extended:
    """A group that takes rows of others: one object of each dataclass registered in it."""

    added: tuple[Any, ...] = field(default=(), kw_only=True)

    def own(self, rows: type[Rows]) -> Rows:
        """Return the values of the rows that a dataclass has brought."""
        return next((one for one in self.added if isinstance(one, rows)), rows())
