# SPDX-License-Identifier: Apache-2.0
"""Delimited text as a table: laid out, named, and refused where it may be read in two ways."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from stickslip_ros.measurement.reading import cells, rohde_schwarz
from stickslip_ros.measurement.reading.layout import Layout, lines_text
from stickslip_ros.measurement.reading.preamble import Preamble
from stickslip_ros.measurement.reading.rows import Rows
from stickslip_ros.measurement.reading.table import Column, Loaded, MeasurementError, Table
from stickslip_ros.measurement.reading.units import Unit
from stickslip_ros.measurement.reading.unpacking import blocks_of, text_start

_WITH_UNIT = re.compile(r"[-+]?\d+(?:[.,]\d+)?(?:[eE][-+]?\d+)?\s*(?P<unit>[^\W\d]\S*)")


def read_text(path: Path, decimal: str | None = None, progress: bool = False) -> Table | None:
    """Return a text table, None if the file is no text. Raises MeasurementError and OSError."""
    begun = text_start(path)
    if begun is None:
        return None
    lines, encoding = begun
    try:
        layout = Layout.of(lines, decimal or _stated_decimal(lines))
    except MeasurementError as error:
        shown = preview_of(lines, 0)
        raise MeasurementError(f"{error}{shown and f'; it begins:{chr(10)}{shown}'}") from None
    preamble = Preamble.of(lines, layout)
    rohde_schwarz.describe(path, layout, preamble)
    _check_units(lines, layout)
    _check_commas(lines, layout, decimal)

    def load(wanted: Sequence[Column]) -> Loaded:
        rows = Rows(layout, wanted, lines)
        for block, last in blocks_of(path, encoding, progress):
            rows.add(block, last)
        return rows.loaded()

    return Table(preamble.columns(layout), load, preview_of(lines, layout.first))


def preview_of(lines: Sequence[str], first: int, count: int = 3) -> str:
    """Return the lines about the first numbers, with their numbers, as people read them."""
    start = max(0, first - 4)
    shown = [(k + 1, lines[k]) for k in range(start, min(first + count, len(lines)))]
    texts = ["".join(c if c.isprintable() else " " for c in text)[:100] for _, text in shown]
    return "\n".join(
        f"  {number:>4} | {text}" for (number, _), text in zip(shown, texts, strict=True)
    ).rstrip()


def _stated_decimal(lines: Sequence[str]) -> str | None:
    """Return the decimal sign that a LabVIEW header states."""
    for line in lines[:30]:
        key, _, sign = line.strip().partition("\t")
        if key == "Decimal_Separator" and sign.strip() in (".", ","):
            return sign.strip()
    return None


def _check_units(lines: Sequence[str], layout: Layout) -> None:
    """Refuse a table that has units beside its numbers."""
    beside = (_WITH_UNIT.fullmatch(cell.strip(' "'))
              for cell in re.split(r"[;\t]|,\s*", lines[layout.first]))  # fmt: skip
    if with_unit := next((one for one in beside if one and Unit.of(one["unit"])), None):
        raise MeasurementError(
            f"line {layout.first + 1} has a unit behind a number ({with_unit[0]!r}); leave numbers "
            "only, and put the unit into the name of the column, as in 'x (nm)'"
        )


def _check_commas(lines: Sequence[str], layout: Layout, decimal: str | None) -> None:
    """Refuse a table whose commas may be read in two ways; decimal is the sign that was given."""
    first, width = layout.first, len(layout.kinds.rstrip("e"))
    header = lines[first - 1].strip() if first else ""
    names = [cell for cell in layout.split(header.lstrip("#% ")) if cell]
    halved = layout.delimiter == "," and not layout.quoted and 2 * len(names) == width
    whole = not any(set(".eE") & set(line) for line in lines[first : first + 50])
    if names and halved and whole:
        raise MeasurementError(
            f"line {first + 1} has {width} values below {len(names)} names; with decimal "
            "commas, separate the values with ; or a tab"
        )
    if layout.decimal != "," or decimal or layout.delimiter == ",":
        return
    begin = lines[first : first + 2000]
    rows = [layout.split(lines_text(one, layout.delimiter)) for one in begin if one.strip()]
    for k in range(width):
        column = [row[k].lstrip("+-") for row in rows if k < len(row) and row[k]]
        with_comma = [cell for cell in column if "," in cell]
        without = [cell for cell in column if "," not in cell]
        thousands = all(cells.is_number(one, ".", True) and one[0] != "0" for one in with_comma)
        if with_comma and without and thousands and all(len(cell) <= 3 for cell in without):
            raise MeasurementError(
                f"column {k + 1}: is {with_comma[0]!r} a number with a decimal comma or one above "
                "a thousand? Say so with --decimal , or --decimal .\n"
                f"{preview_of(lines, first)}"
            )
