# SPDX-License-Identifier: Apache-2.0
"""The report as a folder: pictures, tables and the page, all of it or nothing."""

from __future__ import annotations

import csv
import io
import shutil
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from stickslip_ros import __version__
from stickslip_ros.paper.item import Item, Result, Table
from stickslip_ros.paper.page import Entry, page

PAGE = "index.html"
#: Names what the folder holds, one a line below this one; tells our folders from others.
CONTENTS = "contents.txt"
_FIRST_LINE = "stickslip paper: this folder is replaced as a whole"
_DPI = 150


class FolderError(ValueError):
    """A folder that cannot be written; the message says what to change."""


def refuse_if_not_ours(folder: Path) -> None:
    """Raise FolderError if a folder is there that holds anything we did not write."""
    if not folder.exists() and not folder.is_symlink():
        return
    if not folder.is_dir() or folder.is_symlink():
        raise FolderError(f"{folder} is no folder; choose another --out")
    present = {path.name for path in folder.iterdir()}
    try:
        lines = (folder / CONTENTS).read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError):
        lines = []
    known = {CONTENTS, *lines[1:]} if lines[:1] == [_FIRST_LINE] else set()
    strange = sorted(present - known)
    if strange:
        raise FolderError(
            f"{folder} holds {strange[0]}, which is not of an earlier report; choose another --out"
        )


def report(
    folder: Path,
    items: Sequence[Item],
    executor: Executor,
    progress: Callable[[int], object] = lambda count: None,
) -> list[Entry]:
    """Compute the items on the executor and write the folder; return what came of each.

    An item that fails stands in the page as failed. progress is told 1 for each item done.
    Raises FolderError for a folder that is not ours or cannot be written; then, and if the run
    is interrupted, what was there before stays as it was.
    """
    refuse_if_not_ours(folder)
    target = folder.absolute()
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        work = Path(tempfile.mkdtemp(prefix=f".{target.name}-new-", dir=target.parent))
    except OSError as error:
        raise FolderError(f"cannot write to {folder}: {error.strerror or error}") from None
    try:
        waiting = [executor.submit(item.compute) for item in items]
        entries = []
        try:
            for item, future in zip(items, waiting, strict=True):
                entries.append(_entry(work, item, future.result))
                progress(1)
        finally:
            for future in waiting:
                future.cancel()
        (work / PAGE).write_text(page(entries, __version__), encoding="utf-8")
        names = sorted(path.name for path in work.iterdir())
        (work / CONTENTS).write_text("\n".join([_FIRST_LINE, *names, ""]), encoding="utf-8")
        work.chmod(0o755)
        _put_in_place(work, target)
    except OSError as error:
        raise FolderError(f"cannot write to {folder}: {error.strerror or error}") from None
    finally:
        shutil.rmtree(work, ignore_errors=True)
    return entries


def _entry(work: Path, item: Item, compute: Callable[[], Result]) -> Entry:
    """Write the files of an item and return its entry; one that fails says why."""
    try:
        result = compute()
        picture = _drawn(result)
        tables = {
            f"{item.name}{ending}.csv": _csv(table) for ending, table in result.tables.items()
        }
    except Exception as error:  # whatever it is, the other items are not to blame
        return Entry(item, fault=f"{type(error).__name__}: {error}")
    files = []
    if picture is not None:
        files.append(f"{item.name}.png")
        (work / files[-1]).write_bytes(picture)
    for name, text in tables.items():
        files.append(name)
        (work / name).write_text(text, encoding="utf-8", newline="")
    return Entry(item, result, picture, tuple(files))


def _drawn(result: Result) -> bytes | None:
    if result.draw is None:
        return None
    figure = Figure(figsize=result.size, layout="constrained")
    result.draw(figure)
    png = io.BytesIO()
    figure.savefig(png, dpi=_DPI, format="png", metadata={"Software": None})
    return png.getvalue()


def _csv(table: Table) -> str:
    """Return a table as text: names, then one line for each row, nan as an empty cell."""
    columns = [np.asarray(column, dtype=np.float64).tolist() for column in table.values()]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(table)
    for row in zip(*columns, strict=True):
        writer.writerow(["" if value != value else value for value in row])
    return text.getvalue()


def _put_in_place(work: Path, target: Path) -> None:
    """Move the finished folder to its name; the one before goes away last."""
    if not target.exists():
        work.rename(target)
        return
    old = Path(tempfile.mkdtemp(prefix=f".{target.name}-old-", dir=target.parent))
    target.rename(old / target.name)
    try:
        work.rename(target)
    except OSError:
        (old / target.name).rename(target)
        raise
    finally:
        shutil.rmtree(old, ignore_errors=True)
