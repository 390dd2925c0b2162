# SPDX-License-Identifier: Apache-2.0
"""Extensions of the parameter table: the constants of one friction law or one waveform.

An extension is a frozen dataclass with fields made by `row.number`, `row.text` or `row.switch`.
This room imports no extension; `extensions.ROW_PROVIDERS` names the rooms that register some.
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
    """A group with extensions: one object of each dataclass registered in the group."""

    added: tuple[Any, ...] = field(default=(), kw_only=True)

    def own(self, rows: type[Rows]) -> Rows:
        """Return the values of an extension, given its dataclass."""
        return next((one for one in self.added if isinstance(one, rows)), rows())
