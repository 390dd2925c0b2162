# SPDX-License-Identifier: Apache-2.0
"""The report as files: a page that needs nothing else, tables, all of it or nothing."""

from __future__ import annotations

import base64
import csv
import re
from collections.abc import Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from stickslip_ros.paper import (
    PAGE,
    Check,
    FolderError,
    Item,
    Kind,
    Result,
    Verdict,
    report,
)
from stickslip_ros.paper.errata import ERRATA

REPOSITORY = Path(__file__).parent.parent.parent


def draw(figure: Figure) -> None:
    figure.add_subplot().plot([0, 1])


def good() -> Result:
    return Result(
        checks=(Check("steps < 3 & more", 2.0, "nm", "2", 1.0, 3.0, Kind.NUMBER),),
        tables={"": {"x (m)": np.array([1.0, np.nan])}, "_more": {"y (N)": np.array([0.1])}},
        draw=draw,
        remark="<script>alert(1)</script>",
    )


def bad() -> Result:
    raise ZeroDivisionError("no such law")


def bad_drawing() -> Result:
    return Result(good().checks, good().tables, draw=lambda figure: figure.nothing())  # type: ignore[attr-defined]


def item(name: str, compute: object = good) -> Item:
    return Item(name, f"title of {name}", "Fig. 0", "it steps", "a drive", compute)  # type: ignore[arg-type]


@pytest.fixture
def executor() -> Iterator[Executor]:
    with ThreadPoolExecutor(2) as pool:
        yield pool


class Reader(HTMLParser):
    """Every tag with its attributes."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))


def test_the_folder_holds_page_pictures_and_tables(tmp_path: Path, executor: Executor) -> None:
    seen: list[int] = []
    (entry,) = report(tmp_path / "deep" / "out", [item("fig00")], executor, seen.append)
    assert (entry.verdict, seen) == (Verdict.AGREES.value, [1])
    out = tmp_path / "deep" / "out"
    assert sorted(path.name for path in out.iterdir()) == [
        "contents.txt", "fig00.csv", "fig00.png", "fig00_more.csv", PAGE,
    ]  # fmt: skip
    assert list(csv.reader((out / "fig00.csv").open())) == [["x (m)"], ["1.0"], [""]]
    assert [path.name for path in out.parent.iterdir()] == ["out"]


def test_the_page_needs_nothing_beside_itself(tmp_path: Path, executor: Executor) -> None:
    report(tmp_path / "out", [item("fig00")], executor)
    text = (tmp_path / "out" / PAGE).read_text(encoding="utf-8")
    reader = Reader(text)
    names = {tag for tag, _ in reader.tags}
    assert not names & {"script", "link", "iframe", "object", "embed", "base"}
    for _, attributes in reader.tags:
        for name in ("src", "href", "srcset", "action", "style", "data", "poster"):
            assert re.match(r"#\w|data:image/png;base64,", attributes.get(name) or "#x")
    assert not re.search(r"url\(|@import|https?:", text)
    (image,) = [attributes for tag, attributes in reader.tags if tag == "img"]
    data = (image["src"] or "").partition(",")[2]
    assert base64.b64decode(data) == (tmp_path / "out" / "fig00.png").read_bytes()
    assert image["alt"]


def test_the_page_shows_what_was_compared(tmp_path: Path, executor: Executor) -> None:
    report(tmp_path / "out", [item("fig00")], executor)
    text = (tmp_path / "out" / PAGE).read_text(encoding="utf-8")
    for shown in ("title of fig00", "it steps", "a drive", "steps &lt; 3 &amp; more", "1 to 3",
                  ">agrees<", "fig00_more.csv", "@media print", "width=device-width"):  # fmt: skip
        assert shown in text
    assert "&lt;script&gt;" in text
    ids = {attributes.get("id") for _, attributes in Reader(text).tags}
    links = {(a.get("href") or "")[1:] for tag, a in Reader(text).tags if tag == "a"}
    assert links == {"fig00"}
    assert links <= ids


@pytest.mark.parametrize(
    ("compute", "fault"), [(bad, "no such law"), (bad_drawing, "nothing")], ids=["data", "drawing"]
)
def test_an_item_that_fails_is_named_and_spoils_nothing(
    tmp_path: Path, executor: Executor, compute: object, fault: str
) -> None:
    entries = report(tmp_path / "out", [item("fig00", compute), item("fig01")], executor)
    assert [bool(entry.fault) for entry in entries] == [True, False]
    assert fault in entries[0].fault
    text = (tmp_path / "out" / PAGE).read_text(encoding="utf-8")
    assert "could not be computed" in text
    assert fault in text
    assert not (tmp_path / "out" / "fig00.csv").exists()
    assert (tmp_path / "out" / "fig01.csv").exists()


def test_an_earlier_report_is_replaced_as_a_whole(tmp_path: Path, executor: Executor) -> None:
    report(tmp_path / "out", [item("fig00")], executor)
    report(tmp_path / "out", [item("fig01")], executor)
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert "fig01.png" in names
    assert "fig00.png" not in names
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_an_empty_folder_is_taken(tmp_path: Path, executor: Executor) -> None:
    (tmp_path / "out").mkdir()
    report(tmp_path / "out", [item("fig00")], executor)
    assert (tmp_path / "out" / PAGE).is_file()


def test_a_folder_with_anything_of_others_is_refused(tmp_path: Path, executor: Executor) -> None:
    out = tmp_path / "out"
    report(out, [item("fig00")], executor)
    (out / "notes.txt").write_text("mine", encoding="utf-8")
    before = {path: path.read_bytes() for path in out.iterdir()}
    with pytest.raises(FolderError, match=r"notes\.txt.*choose another --out"):
        report(out, [item("fig01")], executor)
    assert {path: path.read_bytes() for path in out.iterdir()} == before

    (tmp_path / "file").write_text("mine", encoding="utf-8")
    with pytest.raises(FolderError, match="is no folder"):
        report(tmp_path / "file", [item("fig01")], executor)
    assert (tmp_path / "file").read_text(encoding="utf-8") == "mine"


def test_an_interrupted_report_leaves_what_was_there(tmp_path: Path, executor: Executor) -> None:
    out = tmp_path / "out"
    report(out, [item("fig00")], executor)
    before = {path: path.read_bytes() for path in out.iterdir()}

    def interrupt(count: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        report(out, [item("fig01"), item("fig02")], executor, interrupt)
    assert {path: path.read_bytes() for path in out.iterdir()} == before
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_the_mistakes_are_those_of_the_documentation(tmp_path: Path, executor: Executor) -> None:
    text = (REPOSITORY / "docs" / "paper_errata.md").read_text(encoding="utf-8")
    rows = [
        tuple(cell.strip() for cell in line.strip("| ").split(" | "))
        for line in text.splitlines()
        if line.startswith("| ")
    ]
    assert rows[1:] == list(ERRATA)
    report(tmp_path / "out", [], executor)
    page = (tmp_path / "out" / PAGE).read_text(encoding="utf-8")
    for shown in ("kN/mm2", "<code>config/</code>", "see derivations.md"):
        assert shown in page
