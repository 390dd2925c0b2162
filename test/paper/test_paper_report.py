# SPDX-License-Identifier: Apache-2.0
"""The report of the paper, and the verdicts that follow from checks."""

import base64
import csv
import math
import re
import shutil
from collections.abc import Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from file_layer import FileLayer, each_fault
from matplotlib.figure import Figure

from stickslip_ros import paper
from stickslip_ros.files import WriteError
from stickslip_ros.paper import PAGE, Basis, Check, Claim, FolderError, Result, Verdict, report
from stickslip_ros.paper.report import ClaimOutcome, errata

REPOSITORY = Path(__file__).parent.parent.parent


def draw(figure: Figure) -> None:
    figure.add_subplot().plot([0, 1])


def good() -> Result:
    return Result(
        {"steps < 3 & more": (2.0e-9, 9e-9)},
        tables={"": {"x (m)": np.array([1.0, np.nan])}, "_more": {"y (N)": np.array([0.1])}},
        draw=draw,
        height=1.0,
        remark="<script>alert(1)</script>",
    )


def bad() -> Result:
    raise ZeroDivisionError("no such law")


def bad_drawing() -> Result:
    return Result(good().values, good().tables, draw=lambda figure: figure.nothing())  # type: ignore[attr-defined]


def item(name: str, compute: object = good) -> Claim:
    check = Check(
        "steps < 3 & more", unit="m", paper="2 nm", low=1e-9, high=3e-9, basis=Basis.NUMBER,
        why="printed, within 50 %",
    )  # fmt: skip
    texts = f"title of {name}", "Fig. 0", "it steps", "a drive"
    return Claim(name, *texts, compute, [check])  # type: ignore[arg-type]


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


@pytest.mark.long
@pytest.mark.parametrize("earlier", [False, True])
def test_whatever_fails_the_folder_is_whole_or_as_before(
    tmp_path: Path, executor: Executor, earlier: bool
) -> None:
    """Each call of the system fails once, in turn."""
    old = {"contents.txt", PAGE, "fig09.png", "fig09.svg", "fig09.csv", "fig09_more.csv"}
    new = {name.replace("fig09", "fig00") for name in old}
    told = set()
    report(tmp_path / "earlier", [item("fig09")], executor)
    (tmp_path / "faults").mkdir()

    def write(layer: FileLayer, place: Path) -> None:
        number, layer.fail_at = layer.fail_at, -1
        if earlier:
            shutil.copytree(tmp_path / "earlier", place / "out")
            layer.calls.clear()
        layer.fail_at = number
        report(place / "out", [item("fig00")], executor)

    for call, raised, place in each_fault(write, tmp_path / "faults"):
        told.add(call.split()[0])
        found = {path.name for path in place.glob("out/*")}
        if raised is None:
            # What is cleared away afterwards, and a folder that is there already.
            assert call.startswith(("unlink", "rmdir", f"mkdir {place.name}")), call
            assert found == new, call
            continue
        assert isinstance(raised, WriteError), call
        assert "out: No space left on device; make room on the disk" in str(raised), call
        assert found == (old if earlier else set()), call
        assert [path.name for path in place.iterdir()] == (["out"] if earlier else []), call
    assert {"mkdir", "open", "write", "rename"} <= told


def test_the_page_shows_what_was_compared_and_needs_nothing_beside_itself(
    tmp_path: Path, executor: Executor
) -> None:
    seen: list[ClaimOutcome] = []
    (outcome,) = report(tmp_path / "deep" / "out", [item("fig00")], executor, seen.append)
    assert (outcome.verdict, seen) == (Verdict.AGREES.value, [outcome])
    out = tmp_path / "deep" / "out"
    assert sorted(path.name for path in out.iterdir()) == [
        "contents.txt", "fig00.csv", "fig00.png", "fig00.svg", "fig00_more.csv", PAGE,
    ]  # fmt: skip
    assert list(csv.reader((out / "fig00.csv").open())) == [["x (m)"], ["1.0"], [""]]
    assert [path.name for path in out.parent.iterdir()] == ["out"]

    text = (out / PAGE).read_text(encoding="utf-8")
    reader = Reader(text)
    names = {tag for tag, _ in reader.tags}
    assert not names & {"script", "iframe", "object", "embed", "base"}
    for _, attributes in reader.tags:
        for name in ("src", "href", "srcset", "action", "style", "data", "poster"):
            assert re.match(r"#\w|data:(,|image/svg\+xml;base64,)", attributes.get(name) or "#x")
    assert not re.search(r"url\(|@import|https?:", text)
    (image,) = [attributes for tag, attributes in reader.tags if tag == "img"]
    data = (image["src"] or "").partition(",")[2]
    assert base64.b64decode(data) == (out / "fig00.svg").read_bytes()
    assert image["alt"] == "title of fig00. steps < 3 & more: 2.000 nm"

    for shown in (
        "title of fig00", "it steps", "a drive", "steps &lt; 3 &amp; more",
        "1 to 3 nm <small>(printed, within 50 %)",
        ">agrees<", "joint set: disagrees", "9.000 nm", "prefers-color-scheme: dark",
        "fig00_more.csv", "@media print", "width=device-width",
    ):  # fmt: skip
        assert shown in text
    assert "&lt;script&gt;" in text
    ids = {attributes.get("id") for _, attributes in reader.tags}
    links = {(a.get("href") or "")[1:] for tag, a in reader.tags if tag == "a"}
    assert links == {"fig00"}
    assert links <= ids


@pytest.mark.parametrize(
    ("compute", "fault"), [(bad, "no such law"), (bad_drawing, "nothing")], ids=["data", "drawing"]
)
def test_an_item_that_fails_is_named_and_spoils_nothing(
    tmp_path: Path, executor: Executor, compute: object, fault: str
) -> None:
    outcomes = report(tmp_path / "out", [item("fig00", compute), item("fig01")], executor)
    assert [bool(outcome.fault) for outcome in outcomes] == [True, False]
    assert fault in outcomes[0].fault
    text = (tmp_path / "out" / PAGE).read_text(encoding="utf-8")
    assert "could not be computed" in text
    assert fault in text
    assert not (tmp_path / "out" / "fig00.csv").exists()
    assert (tmp_path / "out" / "fig01.csv").exists()


def test_a_folder_with_anything_of_others_is_refused(tmp_path: Path, executor: Executor) -> None:
    out = tmp_path / "out"
    report(out, [item("fig00")], executor)
    (out / "notes.txt").write_text("mine", encoding="utf-8")
    before = {path: path.read_bytes() for path in out.iterdir()}
    with pytest.raises(FolderError, match=r"notes\.txt.*choose another --out"):
        report(out, [item("fig01")], executor)
    assert {path: path.read_bytes() for path in out.iterdir()} == before

    (tmp_path / "file").write_text("mine", encoding="utf-8")
    with pytest.raises(FolderError, match="is not a folder"):
        report(tmp_path / "file", [item("fig01")], executor)
    assert (tmp_path / "file").read_text(encoding="utf-8") == "mine"


def test_an_interrupted_report_leaves_what_was_there(tmp_path: Path, executor: Executor) -> None:
    out = tmp_path / "out"
    report(out, [item("fig00")], executor)
    before = {path: path.read_bytes() for path in out.iterdir()}

    def interrupt(outcome: ClaimOutcome) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        report(out, [item("fig01"), item("fig02")], executor, interrupt)
    assert {path: path.read_bytes() for path in out.iterdir()} == before
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_the_mistakes_are_those_of_the_documentation(tmp_path: Path, executor: Executor) -> None:
    """The documentation has the same table, line by line, and so has the page."""
    shipped = (Path(paper.__file__).parent / "errata.md").read_text(encoding="utf-8")
    assert shipped in (REPOSITORY / "docs" / "paper_errata.md").read_text(encoding="utf-8")
    assert {len(row) for row in errata()} == {4}
    report(tmp_path / "out", [], executor)
    text = (tmp_path / "out" / PAGE).read_text(encoding="utf-8")
    for shown in ("kN/mm2", "<code>config/</code>", "see Constants of the contact"):
        assert shown in text


TREND, NUMBER, NOTHING = Basis.TREND, Basis.NUMBER, Basis.NOTHING


def checks(*found: tuple[Basis, bool]) -> list[Check]:
    """Checks of these kinds, which hold or do not."""
    return [
        Check("x", 1.0 if holds else -1.0, low=0.0, high=2.0, basis=basis) for basis, holds in found
    ]


def test_verdict() -> None:
    for found, verdict in [
        ([(NUMBER, True)], Verdict.AGREES),
        ([(TREND, True), (NUMBER, True), (NOTHING, False)], Verdict.AGREES),
        ([(TREND, True)], Verdict.IN_KIND),
        ([(TREND, True), (NUMBER, True), (NUMBER, False)], Verdict.IN_KIND),
        ([(NUMBER, True), (NUMBER, False)], Verdict.IN_KIND),
        ([(TREND, True), (NUMBER, False)], Verdict.DISAGREES),
        ([(NUMBER, False)], Verdict.DISAGREES),
        ([(TREND, True), (TREND, False), (NUMBER, True)], Verdict.DISAGREES),
    ]:
        assert Verdict.of(checks(*found)) is verdict


X, Y = Check("x", low=1.8, high=2.2, basis=NUMBER), Check("y", low=0.5, high=1.5)


def test_the_joint_set_has_a_verdict_of_its_own() -> None:
    both = Result({"x": (3.0, 2.1), "y": 1.0}).judged([X, Y])
    assert (both.verdict, both.joint_verdict) == (Verdict.DISAGREES, Verdict.AGREES)
    assert Result({"y": 1.0}).judged([Y]).joint_verdict is None


def test_a_settled_verdict_cannot_hide_a_check() -> None:
    """What can be judged is judged, and what cannot says why."""
    for found, check in ((Result({"y": 3.0}, settled=Verdict.DATA), Y),
                         (Result({"y": 1.0}), Check("y", basis=NOTHING))):  # fmt: skip
        with pytest.raises(ValueError, match="either checks to judge"):
            found.judged([check])


@pytest.mark.parametrize("checks", [[X], [X, Y, Check("z")]])
def test_each_value_has_one_check(checks: list[Check]) -> None:
    with pytest.raises(ValueError, match=r"no checks, or no values, of: [yz]"):
        Result({"x": 1.0, "y": 2.0}).judged(checks)


@pytest.mark.parametrize(
    ("value", "holds"), [(0.0, True), (2.0, True), (2.1, False), (-0.1, False), (math.nan, False)]
)
def test_bounds_are_included_and_nan_never_holds(value: float, holds: bool) -> None:
    assert Check("x", value, low=0.0, high=2.0).holds is holds


def test_bounds_as_text() -> None:
    assert Y.bounds == "0.5 to 1.5"
    assert Check("x", unit="m", low=-1e-9, high=-1e-10).bounds == "-1 to -0.1 nm"
    assert Check("x", low=1.0, high=1.0).bounds == "1"
    assert Check("x", basis=NOTHING, low=1.0, high=1.0).bounds == ""
    assert Check("x", 2.527e6, "N/m").text == "2.527 N/µm"
