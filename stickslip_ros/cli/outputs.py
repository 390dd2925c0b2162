# SPDX-License-Identifier: Apache-2.0
"""The results of every command: printed, and as picture, page, table and JSON."""

from __future__ import annotations

import argparse
import json
import re
import shlex
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stickslip_ros.base.errors import UsageError, printable
from stickslip_ros.base.files import check_folder, write_text
from stickslip_ros.base.reporting import to_json
from stickslip_ros.base.reporting.tables import Cell, check_table, write_table
from stickslip_ros.cli.options import flag, option

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from stickslip_ros.base.reporting.page import ResultPage

#: Kinds of pictures, by the end of the file's name.
PICTURES = (".svg", ".pdf", ".png")
_COLOURS = re.compile(r"(\x1b\[[\d;]*m)")
_Table = tuple[Sequence[str], Sequence[Sequence[Cell]]]


def add_outputs(parser: argparse.ArgumentParser, picture: str = "", table: str = "") -> None:
    """Add --report, --table and --json; --plot and --show, too, if there is a picture of something.

    table names its rows, if they are more than the names and values that are printed.
    """
    group = parser.add_argument_group("results, SI units in files")
    if picture:
        option(group, "--plot", "FILE.svg|pdf|png", f"write a picture: {picture}", Path)
        flag(group, "--show", "open that picture")
    option(group, "--report", "FILE.html", "write a page with all that is found", Path)
    option(group, "--table", "FILE.csv|tex", f"write {table or 'names and values'}", Path)
    flag(group, "--json", "print one JSON object")


def check_outputs(args: argparse.Namespace, *others: Path | None) -> None:
    """Raise UsageError, TableError or WriteError for a file that could not be written at the end.

    others are files of other options.
    """
    if getattr(args, "show", False) and not args.plot:
        args.plot = Path(tempfile.mkdtemp(prefix="stickslip-")) / "picture.png"
    plot = getattr(args, "plot", None)
    if plot and plot.suffix.lower() not in PICTURES:
        raise UsageError(f"--plot is {plot}; its name has to end with {', '.join(PICTURES)}")
    if args.table:
        check_table(args.table)
    for path in (plot, args.report, *others):
        if path:
            check_folder(path)


def wants_files(args: argparse.Namespace) -> bool:
    """Return whether a picture, a page or a table is asked for."""
    return bool(getattr(args, "plot", None) or args.report or args.table)


def put_out(
    args: argparse.Namespace,
    content: Mapping[str, Any],
    text: Callable[[], str],
    title: str = "",
    table: _Table | None = None,
    draw: Callable[[Axes], object] | None = None,
    picture: Callable[[], Figure] | None = None,
    page: Callable[[], ResultPage] | None = None,
) -> None:
    """Write and print a result as the options of `add_outputs` ask for.

    content is for JSON (nan becomes null), and makes the table if none is given. The picture is
    what ``draw`` draws, or ``picture`` returns, or the plots of the page. The page, if none is
    given, has the text, that picture and the table.
    """
    plot = getattr(args, "plot", None)
    heading, rows = table or (("name", "value"), [])
    if not table and (args.table or args.report):
        rows = list(_named(content))
    if args.table:
        write_table(args.table, heading, rows)
    if plot or args.report:
        from stickslip_ros.base.reporting.page import result_page
        from stickslip_ros.base.reporting.picture import (
            picture_of,
            picture_of_plots,
            save_picture,
            svg_of,
        )

        whole = page() if page else None
        drawn = picture() if picture else picture_of(draw) if draw else None
        if plot:
            figures = [one.figure for one in whole.plots] if whole else []
            save_picture(plot, drawn or picture_of_plots(figures, title))
        if args.report:
            whole = whole or result_page(
                title, text(), svg_of(drawn) if drawn else None, heading, rows
            )
            write_text(args.report, whole.html(shlex.join(["stickslip", *sys.argv[1:]])))
    if args.json:
        print(json.dumps(to_json(content), allow_nan=False))
    else:  # of what a terminal obeys, only our colours and lines are left
        parts = _COLOURS.split(text())
        print("".join(one if k % 2 else printable(one, "\n") for k, one in enumerate(parts)))


def _named(content: Any, name: str = "") -> Iterator[tuple[str, Cell]]:
    """Yield name and value of every number and text in a content, such as ``runs.1.frequency``."""
    content = to_json(content)
    if isinstance(content, list):
        content = dict(enumerate(content, 1))
    if isinstance(content, dict):
        for key, inner in content.items():
            yield from _named(inner, f"{name}.{key}" if name else str(key))
    else:
        yield name, content
