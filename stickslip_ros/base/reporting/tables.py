# SPDX-License-Identifier: Apache-2.0
"""Tables of results: CSV for programs, LaTeX for papers, data frames for notebooks."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stickslip_ros.base.errors import StickslipError, libraries_for
from stickslip_ros.base.files import check_folder, write_text

if TYPE_CHECKING:
    import pandas

Cell = str | float | None
_SPECIAL = {
    "\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#", "_": r"\_",
    "{": r"\{", "}": r"\}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}",
    "µ": r"\textmu{}", "±": r"\textpm{}", "°": r"\textdegree{}", "−": r"\textminus{}",
    "σ": r"$\sigma$", "²": r"\textsuperscript{2}",
}  # fmt: skip


class TableError(StickslipError, ValueError):
    """A file that no table can be written to; the message names the endings."""


def check_table(path: Path) -> None:
    """Raise TableError or WriteError unless a table can be written to a file of that name."""
    if path.suffix.lower() not in (".csv", ".tex"):
        raise TableError(f"--table {path}: end it in .csv or .tex")
    check_folder(path)


def write_table(path: Path, heading: Sequence[str], rows: Sequence[Sequence[Cell]]) -> None:
    """Write a table, all of it or nothing: SI units, missing values empty. WriteError, TableError.

    A .tex file is a tabular of booktabs, to be read with ``\\input``; numbers have six digits.
    """
    check_table(path)
    text = _latex(heading, rows) if path.suffix.lower() == ".tex" else csv_text(heading, rows)
    write_text(path, text)


def _missing(cell: Cell) -> bool:
    return cell is None or (isinstance(cell, float) and not math.isfinite(cell))


def csv_text(heading: Iterable[str], rows: Iterable[Sequence[Cell]]) -> str:
    """Return a table as CSV; a missing or infinite value is an empty cell."""
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(heading)
    writer.writerows([["" if _missing(cell) else cell for cell in row] for row in rows])
    return file.getvalue()


def _latex(heading: Sequence[str], rows: Sequence[Sequence[Cell]]) -> str:
    numeric = [any(isinstance(row[k], float) for row in rows) for k in range(len(heading))]
    columns = "".join("r" if one else "l" for one in numeric)
    lines = [" & ".join(map(_escaped, heading)), *(" & ".join(map(_tex, row)) for row in rows)]
    head, *body = (rf"{line} \\" for line in lines)
    parts = [rf"\begin{{tabular}}{{{columns}}}", r"\toprule", head, r"\midrule", *body]
    return "\n".join(["% needs booktabs", *parts, r"\bottomrule", r"\end{tabular}", ""])


def _tex(cell: Cell) -> str:
    if _missing(cell):
        return "--"
    if isinstance(cell, str):
        return _escaped(cell)
    mantissa, _, exponent = f"{cell:.6g}".partition("e")
    power = rf" \times 10^{{{int(exponent)}}}" if exponent else ""
    return f"${mantissa}{power}$"


def _escaped(text: str) -> str:
    return "".join(_SPECIAL.get(one, one) for one in text)


def frame(columns: Mapping[str, Any], index: str) -> pandas.DataFrame:
    """Return columns of one length as a pandas DataFrame whose index counts from 1."""
    with libraries_for("to_frame"):
        import pandas
    table = pandas.DataFrame(dict(columns))
    table.index = pandas.RangeIndex(1, len(table) + 1, name=index)
    return table
