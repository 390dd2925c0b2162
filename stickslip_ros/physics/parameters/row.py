# SPDX-License-Identifier: Apache-2.0
"""One parameter: its type, default, unit and range; checks and text forms of its values.

`Parameters` holds None for an optional parameter that is not set. ROS, YAML, bags, the command line
and the rows of the table have no None: they use 0 or an empty text.

An extension of the table is a frozen dataclass with fields made by `number`, `text` or `switch`.
This room imports no extension; `extensions.ROW_PROVIDERS` names the rooms that register some.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

from stickslip_ros.base.errors import StickslipError

#: Magnitude below which no number of the table means anything in SI units; those near 1e-308 lose
#: their digits, and quotients of them overflow.
SMALLEST = 1e-30

Value = float | int | str | bool


class ParameterError(StickslipError, ValueError):
    """A parameter that cannot be used; the message names the value, the limit and the cure."""


def number(
    default: float | None,
    unit: str,
    low: float,
    high: float,
    description: str,
    *,
    reason: str,
    mutable: bool = True,
    least: float = SMALLEST,
) -> Any:
    """Return the field of a number between low and high, both included.

    least is the smallest magnitude except 0, reason explains the limits.
    """
    return _row(unit, description, mutable, default, low=low, high=high, least=least, reason=reason)


def growth_per_kelvin(description: str) -> Any:
    """Return the field of how much a quantity grows in a kelvin, a fraction of that at 293.15 K."""
    return number(
        0.0, "1/K", -2e-3, 3.3e-3, description, least=1e-9,
        reason="beyond, nothing would be left of it at 700 K or at 0 K",
    )  # fmt: skip


def text(default: str | None, description: str, mutable: bool = True, pattern: str = "") -> Any:
    """Return the field of a text, which has to match the pattern if there is one."""
    return _row("", description, mutable, default, pattern=pattern)


def file(description: str) -> Any:
    """Return the field of the path of a file, which is not set by default."""
    return _row("", description, True, None, is_file=True)


def switch(default: bool, description: str, mutable: bool = True) -> Any:
    """Return the field of a value that is true or false."""
    return _row("", description, mutable, default, high=1)


def _row(unit: str, description: str, mutable: bool, default: object, **more: Any) -> Any:
    metadata = {"unit": unit, "description": description, "mutable": mutable, **more}
    return field(default=default, metadata=metadata)


@dataclass(frozen=True)
class Parameter:
    """One row of the table of parameters.

    Numbers lie between ``low`` and ``high`` (both included); except for 0, their magnitude is at
    least ``least``. If ``mutable``, a running axis uses a new value from its next cycle on. A text
    has to match ``pattern``, if there is one.
    """

    name: str
    group: str  #: attribute of `Parameters` that holds it
    rows: type  #: dataclass that defines it: the group, or an extension of a law or a waveform
    kind: type  #: float, int, str or bool
    optional: bool  #: whether 0, or an empty text, stands for "not set"
    default: Value
    unit: str
    description: str
    mutable: bool
    low: float = 0.0
    high: float = 0.0
    least: float = SMALLEST
    reason: str = ""  #: explains the limits
    pattern: str = ""
    is_file: bool = False  #: whether the text names a file

    def check(self, value: object) -> Value:
        """Return ``value`` in the type of the parameter, or raise ParameterError.

        For an optional parameter, None becomes 0 or an empty text. A number may be a text with its
        unit, such as "600mN".
        """
        if self.kind is float and isinstance(value, str):
            value = self.read(value)
        value = value.item() if hasattr(value, "item") else value  # of NumPy
        if self.optional and value is None:
            value = self.kind()
        if self.kind is float and type(value) is int:
            value = _as_float(value)
        if type(value) is not self.kind:
            raise ParameterError(self._type_message(value))
        if isinstance(value, int | float) and not isinstance(value, bool):
            self._check_range(value)
        if self.pattern and not re.fullmatch(self.pattern, str(value)):
            choices = self.pattern.split("|")
            wanted = " or ".join(choices) if choices[1:] else "a letter, then letters, digits and _"
            raise ParameterError(f"{self.name} is {value!r}; it has to be {wanted}")
        return value  # type: ignore[return-value]

    def _check_range(self, value: float) -> None:
        if not math.isfinite(value):
            raise ParameterError(f"{self.name} is {value}; it has to be a finite number")
        if self.low <= value <= self.high and (value == 0.0 or abs(value) >= self.least):
            return
        unit = f" {self.unit}" if self.unit else ""
        allowed = f"between {self.low:g} and {self.high:g}{unit}"
        if 0.0 < abs(value) < self.least:
            allowed = f"between {self.least:g} and {self.high:g}{unit}, or be 0"
        because = f": {self.reason}" if self.reason else ""
        raise ParameterError(f"{self.name} is {value:g}{unit}; it has to lie {allowed}{because}")

    def parse(self, text: str) -> Value:
        """Read a value from text and check it; raise ParameterError."""
        return self.check(self.read(text))

    def read(self, text: str) -> Value:
        """Read a value from text, not checked yet; ParameterError if it is of another type."""
        if self.kind is str:
            return text
        text = text.replace("\u2212", "-")  # as papers and our own tables print it
        if self.kind is float:  # a standard deviation is for those who fit, see `identification`
            text = _DEVIATION.split(text, maxsplit=1)[0].strip()
        try:
            if self.kind is bool:
                return {"true": True, "false": False}[text.lower()]
            return int(text) if self.kind is int else read_quantity(text, self.unit)
        except KeyError:
            raise ParameterError(self._type_message(text)) from None
        except ValueError as error:
            more = f": {error}" if self.kind is float else ""
            raise ParameterError(f"{self._type_message(text)}{more}") from None

    def from_flat(self, value: object) -> Any:
        """Return a checked value, or a column, as `Parameters` holds it: None or nan if not set."""
        if not is_column(value):
            return self.check(value) or None if self.optional else self.check(value)
        column: Any = value
        if self.optional:
            column = column.copy()
            column[column == 0.0] = math.nan
        return column

    def to_flat(self, value: Any) -> Any:
        """Return a value or a column of `Parameters` in flat form: 0 or "" if not set."""
        if value is None:
            return self.kind()
        if self.optional and is_column(value):
            value = value.copy()
            value[value != value] = 0.0
        return value

    def _type_message(self, value: object) -> str:
        wanted = {float: "a number", int: "a whole number", bool: "true or false", str: "a text"}
        return f"{self.name} is {value!r}; it has to be {wanted[self.kind]}"


def file_names(known: Mapping[str, Parameter]) -> list[str]:
    """Return the names of the known parameters that name a file."""
    return [name for name, row in known.items() if row.is_file]


def is_column(value: object) -> bool:
    """Return whether a value is an array with an entry for each of many operating points."""
    return getattr(value, "ndim", 0) > 0


def _as_float(value: int) -> float:
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf


# -- quantities as people type them: ``1kHz``, ``-5 um``, ``200V``, or a number in the SI unit

#: A number as people and instruments write it, as a regular expression.
NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_NUMBER = re.compile(rf"({NUMBER}|[+-]?inf|nan)\s*(.*)")
#: What stands between a number and its standard deviation, ``0.4 +- 0.02``.
_DEVIATION = re.compile(r"\+/?-|±")
#: SI prefixes; micro is u here, whichever letter is typed.
PREFIXES = {
    "": 1.0, "f": 1e-15, "p": 1e-12, "n": 1e-9, "u": 1e-6, "m": 1e-3, "k": 1e3, "M": 1e6, "G": 1e9,
}  # fmt: skip
#: Units that are typed for those of the table, and how much of these one of them is.
_OTHERS = {
    "kg": {"g": 1e-3}, "rad": {"deg": math.pi / 180.0}, "": {"%": 0.01}, "N/m": {"N/um": 1e6},
}  # fmt: skip
#: Factors of which a number is divided by the inverse, which is whole
_WHOLE_PARTS = (1e-15, 1e-12, 1e-9, 1e-6, 1e-3, 0.01)


def read_quantity(text: str, unit: str) -> float:
    """Parse a number, with or without its unit and an SI prefix; return it in the given unit.

    Raises ValueError, with a message that shows how to write the quantity.
    """
    # As papers and our own tables print them.
    plain = text.strip().replace("\u2212", "-").replace("\u00b5", "u").replace("\u03bc", "u")
    found = _NUMBER.fullmatch(plain)
    wanted = f"a number, such as {f'1.5 {unit}'.strip()}"
    if re.match(r"[+-]?\d+,\d", plain):
        raise ValueError(f"{text!r} has a comma; write 1.5 with a point")
    if not found:
        raise ValueError(f"{text!r} is not {wanted}")
    value, typed = float(found[1]), found[2].strip()
    if typed in ("", unit):
        return value
    for name, size in {unit: 1.0, **_OTHERS.get(unit, {})}.items():
        prefix = typed.removesuffix(name)
        if name and typed.endswith(name) and prefix in PREFIXES:
            # Divided, as 5 / 1e6 is the 5e-6 that is meant, and 5 * 1e-6 is not always.
            factor = size * PREFIXES[prefix]
            return value / round(1.0 / factor) if factor in _WHOLE_PARTS else value * factor
    raise ValueError(f"{text!r} is in {typed}; write {wanted}")


# -- extensions of the table: the constants of one friction law or one waveform

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
