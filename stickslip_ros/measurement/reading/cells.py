# SPDX-License-Identifier: Apache-2.0
"""Single cells of a text table: numbers in every spelling, dates and times, gaps, words."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Callable
from datetime import date

_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][+-]?\d+)?")
#: 1,234.5 and 1.234,5 with the sign of the thousands as ','.
_GROUPED = re.compile(r"[+-]?\d{1,3}(?:,\d{3})+(?:\.\d*)?(?:[eE][+-]?\d+)?")
#: What stands for a value that was not measured, a sign before it or not.
_GAPS = {"", "nan", "nan(ind)", "1.#qnan", "1.#ind", "1.#inf", "inf", "infinity", "∞", "null",
         "none", "n/a", "na", "over", "overflow", "ol"}  # fmt: skip
_STAMP = re.compile(
    r"(?:(?P<date>\d{4}[-/.]\d{1,2}[-/.]\d{1,2}|\d{1,2}[-/.]\d{1,2}[-/.]\d{2,4})[T\s_]+)?"
    r"(?P<hour>\d{1,2}):(?P<minute>\d{2}):(?P<second>\d{2}(?:[.,:]\d+)?)\s*"
    r"(?P<half>[AaPp][Mm])?\s*(?P<zone>Z|UTC|[+-]\d{2}:?\d{2})?"
)
#: Values from here on mean that nothing was measured: 9.9e37 is what instruments send then.
LARGEST = 1e30


def splitter(delimiter: str | None, quoted: bool) -> Callable[[str], list[str]]:
    """Return what takes a line apart into stripped cells; delimiter None: blanks."""
    if delimiter is None:
        return lambda line: [cell.strip('"') for cell in line.split()]
    if quoted:

        def split(line: str) -> list[str]:
            try:
                row = next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])
            except csv.Error:
                row = line.split(delimiter)
            return [cell.strip() for cell in row]

        return split
    return lambda line: [cell.strip() for cell in line.split(delimiter)]


def plain(cell: str, decimal: str, grouped: bool = False) -> str:
    """Return a cell with a decimal point and without signs of thousands."""
    if grouped:
        cell = cell.replace("," if decimal == "." else ".", "")
    return cell.replace(",", ".") if decimal == "," else cell


def is_number(cell: str, decimal: str, grouped: bool = False) -> bool:
    """Return whether a cell is a number in the spelling of the table."""
    if grouped:
        swapped = cell.translate({44: 46, 46: 44}) if decimal == "," else cell
        if _GROUPED.fullmatch(swapped):
            return True
        cell = swapped if decimal == "," else cell
        return "," not in cell and _NUMBER.fullmatch(cell) is not None
    if decimal == ",":
        if "." in cell:
            return False
        cell = cell.replace(",", ".")
    return _NUMBER.fullmatch(cell) is not None


def is_gap(cell: str) -> bool:
    """Return whether a cell says that there is no value."""
    return cell.lower().lstrip("+-") in _GAPS or cell.startswith("**")


def is_stamp(cell: str) -> bool:
    """Return whether a cell is a time of the day, with or without a date."""
    return ":" in cell and _STAMP.fullmatch(cell) is not None


def value_of(cell: str, decimal: str, grouped: bool) -> float:
    """Return the number in a cell, nan for a gap. Raises ValueError."""
    if not is_number(cell, decimal, grouped):
        if is_gap(cell):
            return math.nan
        raise ValueError(cell)
    return float(plain(cell, decimal, grouped).replace("d", "e").replace("D", "e"))


class Stamps:
    """Reads dates and times as seconds after the first day that it meets."""

    def __init__(self) -> None:
        self._day: str | None = None

    def seconds(self, cell: str) -> float:
        """Return seconds (s), nan for a gap. Raises ValueError."""
        found = _STAMP.fullmatch(cell)
        if not found:
            if is_gap(cell):
                return math.nan
            raise ValueError(cell)
        hour, day = int(found["hour"]), found["date"]
        if found["half"]:
            hour = hour % 12 + (12 if found["half"].lower() == "pm" else 0)
        second = float(re.sub("[,:]", ".", found["second"]))
        self._day = self._day or day
        days = _ordinal(day) - _ordinal(self._day) if day and day != self._day else 0
        return 86400.0 * days + 3600.0 * hour + 60.0 * int(found["minute"]) + second


def _ordinal(text: str) -> int:
    """Return the number of a day. Raises ValueError where day and month may be swapped."""
    first, second, third = (int(part) for part in re.split("[-/.]", text))
    if first > 31:
        return date(first, second, third).toordinal()
    if "." in text or first > 12:
        return date(third + (2000 if third < 100 else 0), second, first).toordinal()
    raise ValueError(f"{text}: is it the day or the month that comes first?")
