# SPDX-License-Identifier: Apache-2.0
"""How a text table is laid out: separator, decimal sign, where the numbers begin.

Every separator is tried on the first lines. The one that makes the most lines rows of numbers of
the same width is the table's. Columns with words among them do not matter, nor do lines above.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from stickslip_ros.measurement.reading.cells import (
    is_gap,
    is_number,
    is_stamp,
    splitter,
)
from stickslip_ros.measurement.reading.table import MeasurementError
from stickslip_ros.parameters.number_file import unwrapped

COMMENTS = ("#", "%", "//")
#: Separators in the order of preference; None: blanks.
_DELIMITERS = (";", "\t", ",", "|", None)
#: Lines that separators are tried on.
_TRIED = 600
#: Lines after which no table is looked for.
_LONGEST_PREAMBLE = 30_000


@dataclass(frozen=True)
class Layout:
    """The form of a text table."""

    delimiter: str | None  #: None: blanks
    decimal: str
    grouped: bool  #: thousands are set apart
    quoted: bool
    first: int  #: index of the first line of numbers
    kinds: tuple[str, ...]  #: of each column: n numbers, s stamps, w words, e nothing

    @property
    def split(self) -> Callable[[str], list[str]]:
        """Takes a line apart."""
        return splitter(self.delimiter, self.quoted)

    @classmethod
    def of(cls, lines: Sequence[str], decimal: str | None = None) -> Layout:
        """Return the form of a table from its first lines; decimal where it is known.

        Raises MeasurementError if no lines are rows of numbers.
        """
        found: _Try | None = None
        score, form = (False, 1, 0), ""
        start = 0
        # Preambles can be long: on until a stretch of lines is found that are rows of numbers.
        while start < min(len(lines), _LONGEST_PREAMBLE):
            part = range(start, min(start + _TRIED, len(lines)))
            for attempt in _tries(lines, part, decimal):
                whole, count, numbers, kinds = attempt.best()
                if (whole, count, numbers) > score:
                    found, score, form = attempt, (whole, count, numbers), kinds
            if score[0] and score[1] > 0.05 * len(part):
                break
            start += _TRIED
        if found is None:
            raise MeasurementError(
                "no row of numbers; a table has a column of time and one of position"
            )
        first = _first(lines, found, form)
        return cls(found.delimiter, found.decimal, found.grouped, found.quoted, first, tuple(form))


@dataclass(frozen=True)
class _Try:
    delimiter: str | None
    decimal: str
    grouped: bool
    quoted: bool
    rows: dict[int, str]  # index of a line: one letter for each cell

    def best(self) -> tuple[bool, int, int, str]:
        """Return the commonest form of a row and how good it is.

        First whether it is free of words, then how many lines have it, how many numbers it has.
        """
        counts: Counter[int] = Counter()
        for kinds in self.rows.values():
            if "w" not in kinds:
                counts[len(kinds)] += 1
        if counts:
            width, lines = max(counts.items(), key=lambda one: (one[1], one[0]))
            if lines >= 3:
                forms = [kinds for kinds in self.rows.values() if len(kinds) == width]
                whole = [kinds for kinds in forms if "w" not in kinds]
                return True, lines, _numbers(_common(whole)), _common(whole)
        forms_counted = Counter(kinds.replace("e", "n") for kinds in self.rows.values())
        if not forms_counted:
            return False, 0, 0, ""
        form, lines = max(forms_counted.items(), key=lambda one: (one[1], _numbers(one[0])))
        return False, lines, _numbers(form), form


def _numbers(kinds: str) -> int:
    return kinds.count("n") + kinds.count("s")


def _common(forms: Sequence[str]) -> str:
    """Return what each column mostly holds."""
    columns = []
    for cells in zip(*forms, strict=True):
        filled = [kind for kind in cells if kind != "e"]
        columns.append(Counter(filled).most_common(1)[0][0] if filled else "e")
    return "".join(columns)


def is_comment(line: str) -> bool:
    """Return whether a line is a remark."""
    return line.startswith(COMMENTS)


def _tries(lines: Sequence[str], part: range, decimal: str | None) -> list[_Try]:
    texts = {k: unwrapped(lines[k]).strip(" \r\n()[]") for k in part}
    texts = {k: text for k, text in texts.items() if text and not is_comment(text)}
    quoted = any('"' in text for text in texts.values())
    tries = []
    for delimiter in _DELIMITERS:
        if delimiter and not any(delimiter in text for text in texts.values()):
            continue
        if delimiter == decimal == ",":
            continue
        split = splitter(delimiter, quoted)
        rows = {k: split(lines_text(lines[k], delimiter)) for k in texts}
        cells = [cell for row in rows.values() for cell in row]
        for sign in (decimal,) if decimal else _decimals(cells, delimiter, quoted):
            grouped = _is_grouped(cells, sign)
            known = {
                k: "".join(_kind(cell, sign, grouped) for cell in row) for k, row in rows.items()
            }
            known = {k: kinds for k, kinds in known.items() if _numbers(kinds)}
            tries.append(_Try(delimiter, sign, grouped, quoted, known))
    return tries


def lines_text(line: str, delimiter: str | None) -> str:
    """Return a line as it is taken apart: no wrapped numbers, no brackets around."""
    text = unwrapped(line).strip("\r\n")
    text = text.strip(" ") if delimiter == "\t" else text.strip()
    return text[1:-1] if text[:1] + text[-1:] in ("()", "[]") else text


def _decimals(cells: Sequence[str], delimiter: str | None, quoted: bool) -> tuple[str, ...]:
    if delimiter == "," and not quoted:
        return (".",)
    both = [cell for cell in cells if "," in cell and "." in cell]
    if any(is_number(cell, ".", True) for cell in both):
        return (".",)
    return (",", ".") if any("," in cell for cell in cells) else (".",)


def _is_grouped(cells: Sequence[str], decimal: str) -> bool:
    sign = "," if decimal == "." else "."
    return any(
        sign in cell and is_number(cell, decimal, True) and not is_number(cell, decimal)
        for cell in cells
    )


def _kind(cell: str, decimal: str, grouped: bool) -> str:
    if not cell:
        return "e"
    if is_number(cell, decimal, grouped):
        return "n"
    if is_stamp(cell):
        return "s"
    return "e" if is_gap(cell) else "w"


def _first(lines: Sequence[str], found: _Try, form: str) -> int:
    """Return the first line from which on the rows are like the others."""
    wanted = [k for k, kind in enumerate(form) if kind in "ns"]
    split = splitter(found.delimiter, found.quoted)

    def fits(index: int) -> bool:
        cells = split(lines_text(lines[index], found.delimiter))
        if len(cells) < len(wanted) or abs(len(cells) - len(form)) > (found.delimiter is not None):
            return False
        kinds = [_kind(cell, found.decimal, found.grouped) for cell in cells]
        kinds += ["e"] * (len(form) - len(kinds))
        words = any(kinds[k] == "w" for k in wanted)
        return not words and any(kinds[k] in "ns" for k in wanted)

    rows = sorted(k for k, kinds in found.rows.items() if len(kinds) == len(form))
    first = next((k for k in rows if fits(k)), rows[0])
    # Numbers in a preamble are rows only if the lines after them are rows, too.
    for start in (k for k in rows if fits(k)):
        following = [k for k in range(start, min(start + 6, len(lines))) if lines[k].strip()]
        if sum(fits(k) for k in following) >= 0.8 * len(following):
            first = start
            break
    while first > 0 and fits(first - 1) and not is_comment(lines[first - 1].strip()):
        first -= 1
    return first
