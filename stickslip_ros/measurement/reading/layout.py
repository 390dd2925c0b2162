# SPDX-License-Identifier: Apache-2.0
"""How a text table is laid out: separator, decimal sign, where the numbers begin.

Every separator is tried on the first lines. The one that makes the most lines rows of numbers of
the same width is the table's. Columns with words among them do not matter, nor do lines above.
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
#: A number with letters behind it.
_WITH_UNIT = re.compile(r"[-+]?\d+(?:[.,]\d+)?(?:[eE][-+]?\d+)?\s*(?P<unit>[^\W\d]\S*)")


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
        """Return the stripped cells of a line, without quotes and outer brackets."""
        text = unwrap_numbers(line).strip(" \r\n" if self.delimiter == "\t" else None)
        text = text[1:-1] if text[:1] + text[-1:] in ("()", "[]") else text
        if self.delimiter is None:
            return [cell.strip('"') for cell in text.split()]
        if not self.quoted:
            return [cell.strip() for cell in text.split(self.delimiter)]
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
        layout = replace(found[0], first=_first(lines, *found))
        layout.check(lines, decimal)
        return layout

    def kinds_in(self, cells: Sequence[str]) -> str:
        """Return a letter for the kind of each cell."""
        return "".join(
            "n" if number_text(cell, self.decimal, self.grouped)
            else "s" if is_stamp(cell) else "e" if is_gap(cell) else "w"
            for cell in cells
        )  # fmt: skip

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
        halved = self.delimiter == "," and not self.quoted and 2 * len(names) == width
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
            thousands = all(number_text(one, ".", True) and one[0] != "0" for one in with_comma)
            if with_comma and without and thousands and all(len(cell) <= 3 for cell in without):
                raise MeasurementError(
                    f"column {k + 1}: is {with_comma[0]!r} a number with a decimal comma or one "
                    "above a thousand? Say so with --decimal , or --decimal ."
                )


def _tries(
    lines: Sequence[str], part: range, decimal: str | None
) -> Iterator[tuple[Layout, dict[int, str]]]:
    """Yield forms that lines may have, and the kinds of cells in each line with numbers."""
    texts = {k: lines[k].strip(" \r\n()[]") for k in part}
    texts = {k: text for k, text in texts.items() if text and not text.startswith(COMMENTS)}
    quoted = any('"' in text for text in texts.values())
    for mark in _DELIMITERS:
        if mark == decimal == "," or (mark and not any(mark in one for one in texts.values())):
            continue
        plain = Layout(mark, ".", False, quoted)
        rows = {k: plain.split(lines[k]) for k in texts}
        with_comma = [cell for row in rows.values() for cell in row if "," in cell]
        signs = (decimal,) if decimal else (",", ".") if with_comma else (".",)
        if not decimal and any("." in one and number_text(one, ".", True) for one in with_comma):
            signs = (".",)
        for sign in signs:
            cells = [cell for row in rows.values() for cell in row if ",."[sign == ","] in cell]
            grouped = any(number_text(one, sign, True) and not number_text(one, sign)
                          for one in cells)  # fmt: skip
            layout = replace(plain, decimal=sign, grouped=grouped)
            kinds = {k: layout.kinds_in(row) for k, row in rows.items()}
            yield layout, {k: one for k, one in kinds.items() if _numbers(one)}


def _commonest(rows: dict[int, str]) -> tuple[bool, int, str]:
    """Return whether the commonest row is free of words, how many lines have it, its kinds."""
    free = [kinds for kinds in rows.values() if "w" not in kinds]
    lines, width = max((n, width) for width, n in [*Counter(map(len, free)).items(), (0, 0)])
    if lines >= _FEWEST:
        columns = zip(*(kinds for kinds in free if len(kinds) == width), strict=True)
        usual = (Counter(column).most_common() for column in columns)
        return True, lines, "".join(next((k for k, _ in one if k != "e"), "e") for one in usual)
    forms = Counter(kinds.replace("e", "n") for kinds in rows.values())
    form, lines = max(forms.items(), key=lambda one: (one[1], _numbers(one[0])), default=("", 0))
    return False, lines, form


def _numbers(kinds: str) -> int:
    return kinds.count("n") + kinds.count("s")


def _first(lines: Sequence[str], found: Layout, rows: dict[int, str]) -> int:
    """Return the first line from which on the rows are like the others."""
    width = len(found.kinds)
    wanted = [k for k, kind in enumerate(found.kinds) if kind in "ns"]

    def fits(index: int) -> bool:
        cells = found.split(lines[index])
        if len(cells) < len(wanted) or abs(len(cells) - width) > (found.delimiter is not None):
            return False
        kinds = found.kinds_in(cells).ljust(width, "e")
        here = {kinds[k] for k in wanted}
        return "w" not in here and bool(here & {"n", "s"})

    def goes_on(index: int) -> bool:
        following = range(index, min(index + _FOLLOWING, len(lines)))
        fitting = [fits(k) for k in following if lines[k].strip()]
        return sum(fitting) >= _MOST * len(fitting)

    like = sorted(k for k, kinds in rows.items() if len(kinds) == width)
    fitting = [k for k in like if fits(k)]
    # Numbers in a preamble are rows only if the lines after them are rows, too.
    first = next(filter(goes_on, fitting), (fitting or like)[0])
    while first > 0 and fits(first - 1) and not lines[first - 1].strip().startswith(COMMENTS):
        first -= 1
    return first
