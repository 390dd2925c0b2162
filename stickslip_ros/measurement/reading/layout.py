# SPDX-License-Identifier: Apache-2.0
"""How a text table is laid out: separator, decimal sign, where the numbers begin.

Every separator is tried on some lines. The one that makes the most of them rows of numbers of the
same width is the table's. Columns with words among them do not matter, nor do lines above.
"""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from stickslip_ros.measurement.reading.cells import is_gap, is_stamp, number_text
from stickslip_ros.measurement.reading.table import MeasurementError
from stickslip_ros.measurement.reading.units import Unit
from stickslip_ros.physics.parameters.bounded_files import unwrap_numbers

_COMMENTS = ("#", "%", "//")
#: Separators in the order of preference; None: blanks.
_DELIMITERS = (";", "\t", ",", "|", None)
#: Lines that separators are tried on; rows of one width that make a table.
_TRIED, _FEWEST = 600, 3
#: Lines after the first row that are checked, and share of them that have to be rows.
_FOLLOWING, _MOST = 6, 0.8
#: A number with letters behind it.
_WITH_UNIT = re.compile(r"[-+]?\d+(?:[.,]\d+)?(?:[eE][-+]?\d+)?\s*(?P<unit>[^\W\d]\S*)")


@dataclass(frozen=True)
class Layout:
    """The form of a text table."""

    delimiter: str | None  #: None: blanks
    decimal: str
    grouped: bool  #: thousands are set apart
    first: int = 0  #: index of the first line of numbers
    kinds: str = ""  #: of each column: n numbers, s stamps, w words, e nothing

    def split(self, line: str) -> list[str]:
        """Return the stripped cells of a line, without quotes and outer brackets."""
        text = unwrap_numbers(line).strip(" \r\n" if self.delimiter == "\t" else None)
        text = text[1:-1] if text[:1] + text[-1:] in ("()", "[]") else text
        if self.delimiter is None:
            return [cell.strip('"') for cell in text.split()]
        try:
            row = next(csv.reader([text], delimiter=self.delimiter, skipinitialspace=True), [])
        except csv.Error:
            row = text.split(self.delimiter)
        return [cell.strip() for cell in row]

    @classmethod
    def of(cls, lines: Sequence[str], decimal: str | None = None) -> Layout:
        """Return the form of a table from its first lines; decimal where it is known.

        Raises MeasurementError if no lines are rows of numbers, or they may be read in two ways.
        """
        # Preambles can be long: lines are taken from everywhere.
        tried = [line for line in lines[:: 1 + len(lines) // _TRIED] if not is_remark(line)]
        forms = [(*_commonest(rows), layout) for layout, rows in _forms(tried, decimal)]
        whole, count, kinds, found = max(
            forms, key=lambda one: (*one[:2], _numbers(one[2])), default=(False, 0, "", None)
        )
        if found is None or (not whole and count < 2):
            raise MeasurementError(
                "no row of numbers; a table has a column of time and one of position"
            )
        layout = replace(found, kinds=kinds)
        layout = replace(layout, first=layout.first_row(lines))
        layout.check(lines, decimal)
        return layout

    def kinds_in(self, cells: Sequence[str]) -> str:
        """Return a letter for the kind of each cell."""
        return "".join(
            "n" if number_text(cell, self.decimal, self.grouped)
            else "s" if is_stamp(cell) else "e" if is_gap(cell) else "w"
            for cell in cells
        )  # fmt: skip

    def first_row(self, lines: Sequence[str]) -> int:
        """Return the first line from which on the rows are like the others.

        Numbers in a preamble are rows only if the lines after them are rows, too.
        """
        width = len(self.kinds)
        wanted = [k for k, kind in enumerate(self.kinds) if kind in "ns"]

        def fits(line: str, besides: int = self.delimiter is not None) -> bool:
            cells = [] if is_remark(line) else self.split(line)
            if len(cells) < len(wanted) or abs(len(cells) - width) > besides:
                return False
            kinds = self.kinds_in(cells).ljust(width, "e")
            here = {kinds[k] for k in wanted}
            return "w" not in here and bool(here & {"n", "s"})

        def goes_on(index: int) -> bool:
            following = [fits(one) for one in lines[index : index + _FOLLOWING] if one.strip()]
            return sum(following) >= _MOST * len(following)

        def fitting() -> Iterator[int]:
            return (k for k, line in enumerate(lines) if fits(line, besides=0))

        first = next(filter(goes_on, fitting()), next(fitting(), 0))
        while first > 0 and fits(lines[first - 1]):
            first -= 1
        return first

    def check(self, lines: Sequence[str], decimal: str | None) -> None:
        """Raise MeasurementError for units beside numbers, and commas of two meanings.

        decimal is the sign that was given.
        """
        first, width = self.first, len(self.kinds.rstrip("e"))
        cells = re.split(r"[;\t]|,\s*", lines[first])
        beside = (_WITH_UNIT.fullmatch(cell.strip(' "')) for cell in cells)
        if found := next((one for one in beside if one and Unit.of(one["unit"])), None):
            raise MeasurementError(
                f"line {first + 1} has a unit behind a number ({found[0]!r}); leave numbers only, "
                "and put the unit into the name of the column, as in 'x (nm)'"
            )
        header = lines[first - 1].strip().lstrip("#% ") if first else ""
        names = [cell for cell in self.split(header) if cell]
        halved = self.delimiter == "," and 2 * len(names) == width
        if names and halved and not any(set(".eE") & set(one) for one in lines[first : first + 50]):
            raise MeasurementError(
                f"line {first + 1} has {width} values below {len(names)} names; with decimal "
                "commas, separate the values with ; or a tab"
            )
        if self.decimal != "," or decimal or self.delimiter == ",":
            return
        rows = [self.split(line) for line in lines[first : first + 2000] if line.strip()]
        for k in range(width):
            column = [row[k].lstrip("+-") for row in rows if k < len(row) and row[k]]
            with_comma = [cell for cell in column if "," in cell]
            without = [cell for cell in column if "," not in cell]
            thousands = all(number_text(one, ".", True) for one in with_comma)
            if with_comma and without and thousands and all(len(cell) <= 3 for cell in without):
                raise MeasurementError(
                    f"column {k + 1}: is {with_comma[0]!r} a number with a decimal comma or one "
                    "above a thousand? Say so with --decimal , or --decimal ."
                )


def is_remark(line: str) -> bool:
    """Return whether a line is empty or a comment."""
    return not (text := line.strip()) or text.startswith(_COMMENTS)


def _forms(lines: Sequence[str], decimal: str | None) -> Iterator[tuple[Layout, list[str]]]:
    """Yield forms that lines may have, and the kinds of cells in each line with numbers."""
    for mark in _DELIMITERS:
        if mark == decimal == "," or (mark and not any(mark in line for line in lines)):
            continue
        plain = Layout(mark, ".", False)
        rows = [plain.split(line) for line in lines]
        cells = [cell for row in rows for cell in row]
        commas, points = (sum(sign in cell for cell in cells) for sign in ",.")
        # Of two that make as many rows, the first is taken.
        for sign in decimal or (",." if commas and commas >= points else ".,"):
            grouped = any(number_text(one, sign, True) and not number_text(one, sign)
                          for one in cells if ",."[sign == ","] in one)  # fmt: skip
            layout = replace(plain, decimal=sign, grouped=grouped)
            kinds = map(layout.kinds_in, rows)
            yield layout, [one for one in kinds if _numbers(one)]


def _commonest(rows: Sequence[str]) -> tuple[bool, int, str]:
    """Return whether the commonest row is free of words, how many lines have it, its kinds."""
    free = [kinds for kinds in rows if "w" not in kinds]
    lines, width = max((n, width) for width, n in [*Counter(map(len, free)).items(), (0, 0)])
    if lines >= _FEWEST:
        columns = zip(*(kinds for kinds in free if len(kinds) == width), strict=True)
        usual = (Counter(column).most_common() for column in columns)
        return True, lines, "".join(next((k for k, _ in one if k != "e"), "e") for one in usual)
    forms = Counter(kinds.replace("e", "n") for kinds in rows)
    form, lines = max(forms.items(), key=lambda one: (one[1], _numbers(one[0])), default=("", 0))
    return False, lines, form


def _numbers(kinds: str) -> int:
    return kinds.count("n") + kinds.count("s")
