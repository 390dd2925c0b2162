# SPDX-License-Identifier: Apache-2.0
"""How a text table is laid out: separator, decimal sign, where the numbers begin.

Every separator is tried on the first lines. The one that makes the most lines rows of numbers of
the same width is the table's. Columns with words among them do not matter, nor do lines above.

Single cells of a text table: numbers in every spelling, dates and times, gaps, words.
"""

from __future__ import annotations

import contextlib
import csv
import math
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import date

from stickslip_ros.measurement.reading.table import MeasurementError
from stickslip_ros.physics.parameters.bounded_files import unwrap_numbers

_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][+-]?\d+)?")
#: 1,234.5 and 1.234,5 with the sign of the thousands as ','.
_GROUPED = re.compile(r"[+-]?\d{1,3}(?:,\d{3})+(?:\.\d*)?(?:[eE][+-]?\d+)?")
#: Texts for a value that was not measured, with or without a sign.
GAPS = {"", "nan", "nan(ind)", "1.#qnan", "1.#ind", "1.#inf", "inf", "infinity", "∞", "null",
         "none", "n/a", "na", "over", "overflow", "ol"}  # fmt: skip
_STAMP = re.compile(
    r"(?:(?P<date>\d{4}[-/.]\d{1,2}[-/.]\d{1,2}|\d{1,2}[-/.]\d{1,2}[-/.]\d{2,4})[T\s_]+)?"
    r"(?P<hour>\d{1,2}):(?P<minute>\d{2}):(?P<second>\d{2}(?:[.,:]\d+)?)\s*"
    r"(?P<half>[AaPp][Mm])?\s*(?P<zone>Z|UTC|[+-]\d{2}:?\d{2})?"
)
_DAY = 86400.0  #: s
#: Values from here on mean that nothing was measured: 9.9e37 is what instruments send then.
LARGEST = 1e30


def number_text(cell: str, decimal: str, grouped: bool = False) -> str | None:
    """Return a number as Python writes it, None if a cell is none in the spelling of the table."""
    if decimal == ",":
        cell = cell.translate({44: 46, 46: 44})  # commas and points swapped
    if grouped and _GROUPED.fullmatch(cell):
        cell = cell.replace(",", "")
    return cell.lower().replace("d", "e") if _NUMBER.fullmatch(cell) else None


def is_gap(cell: str) -> bool:
    """Return whether a cell is a text for a missing value."""
    return cell.lower().lstrip("+-") in GAPS or cell.startswith("**")


def is_stamp(cell: str) -> bool:
    """Return whether a cell is a time of the day, with or without a date."""
    return ":" in cell and _STAMP.fullmatch(cell) is not None


def value_of(cell: str, decimal: str, grouped: bool) -> float:
    """Return the number in a cell, nan for a gap. Raises ValueError."""
    text = number_text(cell, decimal, grouped)
    if text is None and not is_gap(cell):
        raise ValueError(cell)
    return math.nan if text is None else float(text)


class Stamps:
    """Reads dates and times as seconds after the first day that it meets.

    Times of day without a date are less than half a day apart, so that they may pass midnight.
    """

    def __init__(self) -> None:
        self._day: str | None = None
        self._last: float | None = None  # time of day without a date, s

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
        seconds = 3600.0 * hour + 60.0 * int(found["minute"]) + second
        if day is None:
            last = seconds if self._last is None else self._last
            days = round((last - seconds) / _DAY)
            self._last = _DAY * days + seconds
        return _DAY * days + seconds


def _ordinal(text: str) -> int:
    """Return the number of a day. Raises ValueError where day and month may be swapped."""
    first, second, third = (int(part) for part in re.split("[-/.]", text))
    if first > 31:
        return date(first, second, third).toordinal()
    if "." in text or first > 12:
        return date(third + (2000 if third < 100 else 0), second, first).toordinal()
    raise ValueError(f"{text}: is it the day or the month that comes first?")


COMMENTS = ("#", "%", "//")
#: Separators in the order of preference; None: blanks.
_DELIMITERS = (";", "\t", ",", "|", None)
#: Lines that separators are tried on.
_TRIED = 600
#: Lines after which no table is looked for.
_LONGEST_PREAMBLE = 30_000
#: Rows of one width that make a table; share of the lines tried that ends the search for one.
_FEWEST, _ENOUGH = 3, 0.05
#: Lines after the first row that are checked, and share of them that have to be rows.
_FOLLOWING, _MOST = 6, 0.8


@dataclass(frozen=True)
class Layout:
    """The form of a text table."""

    delimiter: str | None  #: None: blanks
    decimal: str
    grouped: bool  #: thousands are set apart
    quoted: bool
    first: int = 0  #: index of the first line of numbers
    kinds: str = ""  #: of each column: n numbers, s stamps, w words, e nothing

    def split(self, line: str) -> list[str]:
        """Return the stripped cells of a line."""
        if self.delimiter is None:
            return [cell.strip('"') for cell in line.split()]
        row = line.split(self.delimiter)
        if self.quoted:
            with contextlib.suppress(csv.Error):
                row = next(csv.reader([line], delimiter=self.delimiter, skipinitialspace=True), [])
        return [cell.strip() for cell in row]

    @classmethod
    def of(cls, lines: Sequence[str], decimal: str | None = None) -> Layout:
        """Return the form of a table from its first lines; decimal where it is known.

        Raises MeasurementError if no lines are rows of numbers.
        """
        found: tuple[Layout, dict[int, str]] | None = None
        score, start = (False, 1, 0), 0
        # Preambles can be long: on until a stretch of lines is found that are rows of numbers.
        while start < min(len(lines), _LONGEST_PREAMBLE):
            part = range(start, min(start + _TRIED, len(lines)))
            for layout, rows in _tries(lines, part, decimal):
                whole, count, kinds = _commonest(rows)
                if (whole, count, _numbers(kinds)) > score:
                    score = whole, count, _numbers(kinds)
                    found = replace(layout, kinds=kinds), rows
            if score[0] and score[1] > _ENOUGH * len(part):
                break
            start += _TRIED
        if found is None:
            raise MeasurementError(
                "no row of numbers; a table has a column of time and one of position"
            )
        return replace(found[0], first=_first(lines, *found))

    def kinds_in(self, cells: Sequence[str]) -> str:
        """Return a letter for the kind of each cell."""

        def kind(cell: str) -> str:
            if number_text(cell, self.decimal, self.grouped):
                return "n"
            return "s" if is_stamp(cell) else "e" if is_gap(cell) else "w"

        return "".join(map(kind, cells))


def _tries(
    lines: Sequence[str], part: range, decimal: str | None
) -> Iterator[tuple[Layout, dict[int, str]]]:
    """Yield forms that lines may have, and the kinds of cells in each line with numbers."""
    texts = {k: unwrap_numbers(lines[k]).strip(" \r\n()[]") for k in part}
    texts = {k: text for k, text in texts.items() if text and not text.startswith(COMMENTS)}
    quoted = any('"' in text for text in texts.values())
    for delimiter in _DELIMITERS:
        if delimiter and not any(delimiter in text for text in texts.values()):
            continue
        if delimiter == decimal == ",":
            continue
        plain = Layout(delimiter, ".", False, quoted)
        rows = {k: plain.split(lines_text(lines[k], delimiter)) for k in texts}
        cells = [cell for row in rows.values() for cell in row]
        for sign in (decimal,) if decimal else _decimals(cells, delimiter, quoted):
            layout = replace(plain, decimal=sign, grouped=_is_grouped(cells, sign))
            kinds = {k: layout.kinds_in(row) for k, row in rows.items()}
            yield layout, {k: one for k, one in kinds.items() if _numbers(one)}


def _commonest(rows: dict[int, str]) -> tuple[bool, int, str]:
    """Return whether the commonest row is free of words, how many lines have it, its kinds."""
    counts = Counter(len(kinds) for kinds in rows.values() if "w" not in kinds)
    width, lines = max(counts.items(), key=lambda one: (one[1], one[0]), default=(0, 0))
    if lines >= _FEWEST:
        whole = [kinds for kinds in rows.values() if len(kinds) == width and "w" not in kinds]
        columns = (Counter("".join(column).replace("e", "")) for column in zip(*whole, strict=True))
        return True, lines, "".join(max(one, key=one.__getitem__, default="e") for one in columns)
    forms = Counter(kinds.replace("e", "n") for kinds in rows.values())
    form, lines = max(forms.items(), key=lambda one: (one[1], _numbers(one[0])), default=("", 0))
    return False, lines, form


def _numbers(kinds: str) -> int:
    return kinds.count("n") + kinds.count("s")


def lines_text(line: str, delimiter: str | None) -> str:
    """Return a line ready to be split: without wrapped numbers and outer brackets."""
    text = unwrap_numbers(line).strip("\r\n")
    text = text.strip(" ") if delimiter == "\t" else text.strip()
    return text[1:-1] if text[:1] + text[-1:] in ("()", "[]") else text


def _decimals(cells: Sequence[str], delimiter: str | None, quoted: bool) -> tuple[str, ...]:
    if delimiter == "," and not quoted:
        return (".",)
    if any("." in cell and number_text(cell, ".", True) for cell in cells if "," in cell):
        return (".",)
    return (",", ".") if any("," in cell for cell in cells) else (".",)


def _is_grouped(cells: Sequence[str], decimal: str) -> bool:
    sign = "," if decimal == "." else "."
    return any(number_text(cell, decimal, True) and not number_text(cell, decimal)
               for cell in cells if sign in cell)  # fmt: skip


def _first(lines: Sequence[str], found: Layout, rows: dict[int, str]) -> int:
    """Return the first line from which on the rows are like the others."""
    width = len(found.kinds)
    wanted = [k for k, kind in enumerate(found.kinds) if kind in "ns"]

    def fits(index: int) -> bool:
        cells = found.split(lines_text(lines[index], found.delimiter))
        if len(cells) < len(wanted) or abs(len(cells) - width) > (found.delimiter is not None):
            return False
        kinds = found.kinds_in(cells).ljust(width, "e")
        here = {kinds[k] for k in wanted}
        return "w" not in here and bool(here & {"n", "s"})

    like = sorted(k for k, kinds in rows.items() if len(kinds) == width)
    fitting = [k for k in like if fits(k)]
    first = (fitting or like)[0]
    # Numbers in a preamble are rows only if the lines after them are rows, too.
    for start in fitting:
        end = min(start + _FOLLOWING, len(lines))
        following = [k for k in range(start, end) if lines[k].strip()]
        if sum(fits(k) for k in following) >= _MOST * len(following):
            first = start
            break
    while first > 0 and fits(first - 1) and not lines[first - 1].strip().startswith(COMMENTS):
        first -= 1
    return first
