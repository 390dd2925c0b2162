# SPDX-License-Identifier: Apache-2.0
"""Measurements as text tables: which columns, in which units, with which separators.

A table has a column of time and one of position, perhaps one of the actuator's deflection. Above
it may stand a line of names, each with its unit, as ``x (nm)``, ``time [ms]`` or ``x / nm``, and
any other lines. ``#`` and ``%`` begin a comment; names in the last one before the numbers count.
Values are separated by ``;``, tabs, ``,`` or blanks, and a decimal comma is understood where it
cannot be a separator. docs/compare.md shows examples.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.traces.motion import Motion

#: Units of time in s, of length in m.
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0}
LENGTH_UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "nm": 1e-9, "pm": 1e-12}
#: What the columns hold, the units that go with it, and names that are found by themselves.
QUANTITIES = {"t": "time", "x": "position", "u": "actuator deflection"}
_UNITS = {"t": TIME_UNITS, "x": LENGTH_UNITS, "u": LENGTH_UNITS}
_KNOWN_NAMES = {
    "t": ("t", "time", "timestamp", "zeit"),
    "x": ("x", "position", "pos", "runner", "slider", "displacement", "distance", "weg"),
    "u": ("u", "actuator", "piezo"),
}
#: Rows below which nothing can be said.
_FEWEST = 16
#: Numbers above are none of a sensor or clock, in whatever unit; their squares can be summed.
_LARGEST = 1e100
_COMMENTS = ("#", "%")
_WITH_UNIT = re.compile(r"(?P<name>.*?)\s*(?:\((?P<a>[^()]*)\)|\[(?P<b>[^\[\]]*)\]|/\s*(?P<c>\w+))")


class MeasurementError(ValueError):
    """A measurement that cannot be read; the message names the place and the cure."""


@dataclass(frozen=True)
class _Column:
    number: int  # from 1
    name: str  # without its unit
    unit: str | None

    def __str__(self) -> str:
        unit = f" ({self.unit})" if self.unit else ""
        return f"{self.number} {self.name}{unit}" if self.name else str(self.number)


@dataclass(frozen=True)
class _Form:
    """How a table is written."""

    first: int  # index of the first line of numbers
    delimiter: str | None  # None: blanks
    decimal: str
    columns: list[_Column]

    def split(self, line: str) -> list[str]:
        return [cell.strip().strip('"').strip() for cell in line.strip().split(self.delimiter)]


def read_measurement(
    path: Path, columns: Mapping[str, str] | None = None, units: Mapping[str, str] | None = None
) -> Motion:
    """Read a table from a file.

    columns tells for "t", "x" and "u" the name of the column or its number, from 1; units tells
    their units and outdoes the names in the file. Raises MeasurementError.
    """
    columns, units = columns or {}, units or {}
    for key in (*columns, *units):
        if key not in QUANTITIES:
            known = ", ".join(f"{key} ({what})" for key, what in QUANTITIES.items())
            raise MeasurementError(f"there is no quantity {key!r}; known: {known}")
    lines = _lines(path)
    try:
        form = _form(lines)
        found = {key: _find(form, key, columns.get(key)) for key in QUANTITIES}
        chosen = {key: column for key, column in found.items() if column is not None}
        scale = {key: _scale(key, column, units.get(key)) for key, column in chosen.items()}
        numbers = [column.number - 1 for column in chosen.values()]
        table = dict(zip(chosen, _numbers(lines, form, numbers).T, strict=True))
        _check(table, chosen, lines, form)
    except MeasurementError as error:
        raise MeasurementError(f"{path}: {error}") from None
    scaled = {key: scale[key] * values for key, values in table.items()}
    return Motion(path.name, scaled["t"], scaled["x"], u=scaled.get("u"))


def parse_pairs(text: str) -> dict[str, str]:
    """Read ``t=NAME,x=NAME`` as typed on a command line; raise MeasurementError."""
    pairs = {}
    for part in text.split(","):
        key, sign, value = (piece.strip() for piece in part.partition("="))
        if not sign or not value:
            raise MeasurementError(f"{text!r} is not of the form t=...,x=...")
        pairs[key] = value
    return pairs


def _lines(path: Path) -> list[str]:
    try:
        content = path.read_bytes()
    except OSError as error:
        raise MeasurementError(f"cannot read {path}: {error.strerror or error}") from None
    marked = content.startswith((b"\xff\xfe", b"\xfe\xff"))
    if b"\0" in content[:4096] and not marked:
        raise MeasurementError(f"{path} is not a text file; export the measurement as CSV")
    try:
        return content.decode("utf-16" if marked else "utf-8-sig").splitlines()
    except UnicodeDecodeError:
        return content.decode("latin-1").splitlines()  # instruments that write µm in one byte


def _form(lines: list[str]) -> _Form:
    header, above = "", ""
    for index, line in enumerate(lines):
        text = line.strip()
        if not text:
            continue
        if text.startswith(_COMMENTS):
            above = text.lstrip("#% ")
            continue
        delimiter, decimal = _separators(text)
        form = _Form(index, delimiter, decimal, [])
        cells = form.split(text)
        if len(cells) > 1 and all(_is_number(cell, decimal) for cell in cells if cell):
            names = _names(header or above, form, len(cells))
            return _Form(index, delimiter, decimal, names)
        header = text
    raise MeasurementError(
        "no row of two or more numbers; a table has a column of time and one of position"
    )


def _separators(line: str) -> tuple[str | None, str]:
    """Return the delimiter (None: blanks) and the decimal sign of a line of numbers."""
    for delimiter in (";", "\t"):
        if delimiter in line:
            return delimiter, "," if "," in line else "."
    # 1,5 2,5 has decimal commas; 1.5, 2.5 and 1,2 have commas between the values
    words = line.split()
    if len(words) > 1 and not any(word.endswith(",") for word in words) and "." not in line:
        return None, "," if "," in line else "."
    return ("," if "," in line else None), "."


def _is_number(cell: str, decimal: str) -> bool:
    try:
        float(cell.replace(decimal, "."))
    except ValueError:
        return False
    return True


def _names(header: str, form: _Form, count: int) -> list[_Column]:
    """Return the columns, nameless if the header does not fit the numbers."""
    names = form.split(header) if header else []
    if len(names) != count and form.delimiter is None:
        names = [name.strip() for name in re.split(r"\s{2,}|\t|[,;]", header)]
        if len(names) != count:
            names = re.findall(r"[^\s(\[]+(?:\s*[(\[][^)\]]*[)\]])?", header)
    if len(names) != count:
        if header and form.delimiter == "," and 2 * len(names) == count:
            raise MeasurementError(
                f"line {form.first + 1} has {count} values below {len(names)} names; with decimal "
                "commas, separate the values with ; or a tab"
            )
        names = [""] * count
    columns = []
    for number, name in enumerate(names, start=1):
        match = _WITH_UNIT.fullmatch(name)
        unit = (match["a"] or match["b"] or match["c"]) if match else None
        columns.append(_Column(number, match["name"].strip() if match else name, unit))
    return columns


def _find(form: _Form, key: str, wanted: str | None) -> _Column | None:
    """Return the column of a quantity; None for an optional one that is not there."""
    listed = ", ".join(map(str, form.columns))
    if wanted is not None:
        for column in form.columns:
            plain = column.name.lower() == wanted.lower() and column.name
            full = f"{column.name} ({column.unit})".lower() == wanted.lower()
            if plain or full or wanted == str(column.number):
                return column
        raise MeasurementError(f"there is no column {wanted!r}; the columns are: {listed}")
    for name in _KNOWN_NAMES[key]:
        for column in form.columns:
            if column.name.lower() == name:
                return column
    if key == "u":
        return None
    if len(form.columns) == 2 or not any(column.name for column in form.columns):
        return form.columns["tx".index(key)]
    raise MeasurementError(
        f"which column is the {QUANTITIES[key]}? Say so with {key}=NAME or {key}=NUMBER; "
        f"the columns are: {listed}"
    )


def _scale(key: str, column: _Column, given: str | None) -> float:
    """Return the factor to SI of a column."""
    unit = given if given is not None else column.unit
    table = _UNITS[key]
    known = ", ".join(table)
    where = f"column {column} ({QUANTITIES[key]})"
    if not unit:
        raise MeasurementError(
            f"{where} states no unit; write it into the name, such as {key} ({list(table)[2]}), "
            f"or give {key}=UNIT with UNIT one of {known}"
        )
    plain = unit.strip().replace("µ", "u").replace("μ", "u")
    if plain not in table:
        raise MeasurementError(f"{where}: the unit {unit!r} is not one of {known}")
    return table[plain]


def _data_lines(lines: list[str], form: _Form) -> Iterator[tuple[int, str]]:
    """Yield number and text of the lines that hold values."""
    for number, line in enumerate(lines[form.first :], start=form.first + 1):
        text = line.strip()
        if text and not text.startswith(_COMMENTS):
            yield number, text


def _numbers(lines: list[str], form: _Form, columns: list[int]) -> NDArray[np.float64]:
    """Return the columns asked for, (rows, columns)."""
    rows = (text for _, text in _data_lines(lines, form))
    if form.decimal == ",":
        rows = (text.replace(",", ".") for text in rows)
    try:
        return np.loadtxt(
            rows,
            delimiter=form.delimiter,
            usecols=columns,
            comments="#",
            quotechar='"',
            ndmin=2,
        )
    except ValueError:
        raise MeasurementError(_first_fault(lines, form, columns)) from None


def _first_fault(lines: list[str], form: _Form, columns: list[int]) -> str:
    for number, text in _data_lines(lines, form):
        cells = form.split(re.split("[#%]", text)[0])
        if len(cells) <= max(columns):
            count = f"{len(cells)} value{'s' if len(cells) > 1 else ''}"
            return (
                f"line {number} has {count}, column {max(columns) + 1} is missing; "
                "remove the line or complete it"
            )
        for column in columns:
            if not _is_number(cells[column], form.decimal):
                return (
                    f"line {number}, column {column + 1}: {cells[column]!r} is not a number; "
                    "remove the line or mark it as a comment with #"
                )
    return "the numbers cannot be read; write them as 1.5 or 1.5e-9"


def _check(
    table: dict[str, NDArray[np.float64]],
    chosen: dict[str, _Column],
    lines: list[str],
    form: _Form,
) -> None:
    def place(row: int, key: str) -> str:
        number, _ = next(one for k, one in enumerate(_data_lines(lines, form)) if k == row)
        return f"line {number}, column {chosen[key]}"

    rows = len(table["t"])
    if rows < _FEWEST:
        raise MeasurementError(f"{rows} rows of numbers; {_FEWEST} or more are needed")
    for key, values in table.items():
        if not np.isfinite(values).all():
            row = int(np.argmin(np.isfinite(values)))
            raise MeasurementError(f"{place(row, key)}: {values[row]} is no value; remove the line")
        row = int(np.argmax(np.abs(values)))
        if abs(values[row]) > _LARGEST:
            raise MeasurementError(
                f"{place(row, key)}: {values[row]:g} is beyond all measure; remove the line"
            )
    t = table["t"]
    if not (np.diff(t) > 0.0).all():
        row = int(np.argmin(np.diff(t) > 0.0)) + 1
        raise MeasurementError(
            f"{place(row, 't')}: the time {t[row]:.17g} does not come after {t[row - 1]:.17g}; "
            "sort the rows by time and keep each time once"
        )
