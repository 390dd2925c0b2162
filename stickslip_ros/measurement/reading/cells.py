# SPDX-License-Identifier: Apache-2.0
"""Single cells of a text table: numbers in every spelling, dates and times, gaps, words."""

from __future__ import annotations

import math
import re
from datetime import date

import numpy as np
from numpy.typing import NDArray

_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][+-]?\d+)?")
#: 1,234.5 and 1.234,5 with the sign of the thousands as ','.
_GROUPED = re.compile(r"[+-]?[1-9]\d{0,2}(?:,\d{3})+(?:\.\d*)?(?:[eE][+-]?\d+)?")
#: Texts for a value that was not measured, with or without a sign.
_GAPS = {"", "nan", "nan(ind)", "1.#qnan", "1.#ind", "1.#inf", "inf", "infinity", "∞", "null",
         "none", "n/a", "na", "over", "overflow", "ol"}  # fmt: skip
_STAMP = re.compile(
    r"(?:(?P<date>\d{4}[-/.]\d{1,2}[-/.]\d{1,2}|\d{1,2}[-/.]\d{1,2}[-/.]\d{2,4})[T\s_]+)?"
    r"(?P<hour>\d{1,2}):(?P<minute>\d{2}):(?P<second>\d{2}(?:[.,:]\d+)?)\s*"
    r"(?P<half>[AaPp][Mm])?\s*(?P<zone>Z|UTC|(?P<sign>[+-])(?P<off>\d{2}):?(?P<by>\d{2}))?"
)
_DAY = 86400.0  #: s
#: Unit of a column of dates or times of the day that have their offset from UTC.
UTC = "UTC"


def number_text(cell: str, decimal: str, grouped: bool = False) -> str | None:
    """Return a number as Python writes it, None if a cell is none in the spelling of the table."""
    if decimal == ",":
        cell = cell.translate({44: 46, 46: 44})  # commas and points swapped
    if grouped and _GROUPED.fullmatch(cell):
        cell = cell.replace(",", "")
    return cell.lower().replace("d", "e") if _NUMBER.fullmatch(cell) else None


def is_gap(cell: str) -> bool:
    """Return whether a cell is a text for a missing value."""
    return cell.lower().lstrip("+-") in _GAPS or cell.startswith("**")


def is_stamp(cell: str) -> bool:
    """Return whether a cell is a time of the day, with or without a date."""
    return ":" in cell and _STAMP.fullmatch(cell) is not None


def has_offset(cell: str) -> bool:
    """Return whether a cell is a time with its offset from UTC."""
    return bool((found := _STAMP.fullmatch(cell)) and found["zone"])


def value_of(cell: str, decimal: str, grouped: bool) -> float:
    """Return the number in a cell, nan for a gap. Raises ValueError."""
    text = number_text(cell, decimal, grouped)
    if text is None and not is_gap(cell):
        raise ValueError(cell)
    return math.nan if text is None else float(text)


class Stamps:
    """Reads dates and times as seconds after the begin of the first day that it meets.

    Where they have an offset from UTC, all have to, and the day is that of UTC.
    """

    def __init__(self) -> None:
        self._day: str | None = None
        self._offset: bool | None = None

    def seconds(self, cell: str) -> float:
        """Return seconds (s), nan for a gap. Raises ValueError."""
        found = _STAMP.fullmatch(cell)
        if not found:
            if is_gap(cell):
                return math.nan
            raise ValueError(cell)
        hour, day, zone = int(found["hour"]), found["date"], found["zone"] is not None
        if found["half"]:
            hour = hour % 12 + (12 if found["half"].lower() == "pm" else 0)
        seconds = 60.0 * (60 * hour + int(found["minute"]))
        seconds += float(re.sub("[,:]", ".", found["second"]))
        self._day = self._day or day
        self._offset = zone if self._offset is None else self._offset
        if zone != self._offset:
            raise ValueError(f"{cell}: some times have an offset from UTC")
        if found["sign"]:
            ahead = 60.0 * (60 * int(found["off"]) + int(found["by"]))
            seconds += ahead if found["sign"] == "-" else -ahead
        if day is None or day == self._day:
            return seconds
        return seconds + _DAY * (_ordinal(day) - _ordinal(self._day or day))

    def going_on(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return times (s), (samples,); those of the day go on at midnight, gaps are nan.

        Each of them is less than half a day from the next.
        """
        there = np.isfinite(times)
        if self._day is not None or not there.any():
            return times
        steps = np.diff(times[there], prepend=times[there][0])
        whole = times.copy()
        whole[there] -= _DAY * np.cumsum(np.rint(steps / _DAY))
        return whole


def _ordinal(text: str) -> int:
    """Return the number of a day. Raises ValueError where day and month may be swapped."""
    first, second, third = (int(part) for part in re.split("[-/.]", text))
    if first > 31:
        return date(first, second, third).toordinal()
    if "." in text or first > 12:
        return date(third + (2000 if third < 100 else 0), second, first).toordinal()
    raise ValueError(f"{text}: is it the day or the month that comes first?")
