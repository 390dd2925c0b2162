# SPDX-License-Identifier: Apache-2.0
"""What the paper claims, its numbers, and the report of both; the whole is journey 6."""

import base64
import csv
import math
import re
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from stickslip_ros.physics.parameters import Parameters, read_yaml
from validation.paper import __main__ as command
from validation.paper.claim import Basis, Check, Claim, ClaimVerdict, Result
from validation.paper.parameter_sets import EPM_CALC, EPM_FIX, JOINT, JOINT_SENSOR, Set, columns
from validation.paper.parameter_sets import steps as steps_over
from validation.paper.report import CLAIMS, PAGE, errata, report
from validation.whole_system import positions

ROOT = Path(__file__).resolve().parents[2]
TREND, NUMBER, NOTHING = Basis
LONG = pytest.mark.long


# -- the numbers


@cache
def values_of(name: str) -> dict[str, float]:
    """The numbers of a claim, computed once in this process."""
    (claim,) = [claim for claim in CLAIMS if claim.name == name]
    return {check.what: check.value for check in claim.compute().checks}


@pytest.mark.long
@pytest.mark.parametrize(
    ("base", "printed"),
    [
        ({**EPM_FIX, "preload": 0.1}, 91e-9),
        ({**EPM_FIX, "preload": 1.0}, 33e-9),
        ({**EPM_CALC, "preload": 1.0}, 3.77e-9),
        ({**EPM_CALC, "preload": 1.5}, -10.7e-9),
        (JOINT, 136.5e-9),
    ],
)
def test_steps_are_those_of_an_integrator_that_shares_no_code(base: Set, printed: float) -> None:
    """At 1 kHz, where ten cycles are soon integrated, and at 100 Hz in the known numbers."""
    p = Parameters.of({**base, "frequency": 1e3})
    preload = np.array([p.friction.preload])
    (step,) = steps_over({**base, "frequency": 1e3}, 10, preload=preload)
    found = float(np.mean(np.diff(positions(p, 10))[-3:]))
    assert found == pytest.approx(step, abs=0.02e-9)
    (slow,) = steps_over(base, preload=preload)
    assert slow == pytest.approx(printed, abs=0.5e-9)


def test_the_sets_are_those_of_table_1_and_of_the_file_that_is_shipped() -> None:
    p = columns({})  # the claims say "Table 1" where they change nothing
    assert (p.runner.mass, p.friction.preload, p.drive.amplitude) == (4e-3, 0.4, 300.0)
    assert (p.drive.frequency, p.drive.slewrate) == (100.0, 100.0)
    file = ROOT / "config" / "paper_joint_set.yaml"
    shipped = read_yaml(file)
    fit = {name: shipped.flat()[name] for name in ("sigma_0_slope", "sigma_0_offset")}
    assert shipped == columns({**JOINT, **fit, "sigma_0": None})
    assert f"{1e-5 * JOINT_SENSOR:.1f}e5 N/m" in file.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("name", "what", "known", "within"),
    [
        ("fig02b", "first rise of the actuator: gain times voltage", 184e-9, 0.2e-9),
        ("fig02b", "second rise of the actuator short of gain times voltage", 24e-9, 0.1e-9),
        ("sec3", "LuGre: drift in a cycle, 2 nm of vibration", -0.66e-9, 0.01e-9),
        ("sec45", "width of a loop after Bouc and Wen", 15.0, 0.1),
        ("sec45", "largest error of this loop, identified", 0.22, 0.1),
        ("sec52", "6 contacts over one with sigma_0 itself", 1.159, 0.001),
        ("fig07", "forward against backward", 0.0, 0.02e-9),
        ("fig07", "spread over slewrate, intersection", 1.15, 0.05),
        ("fig07", "what it would take: z_ba at both ends above that in the middle", 2.9, 0.1),
        ("fig07", "depth of the minimum with such a z_ba", 1e-9, 0.2e-9),
        pytest.param("fig04c", "smallest step at 5 %, alpha with |z|", 0.0, 1e-11, marks=LONG),
        pytest.param("fig04c", "lowest step, CEIM, 50 %", -39.2e-9, 0.1e-9, marks=LONG),
        pytest.param("fig04c", "lowest step, CEIM, 90 %", -91.2e-9, 0.1e-9, marks=LONG),
        pytest.param("shaping", "step, two parts, at 0.4 N", 111e-9, 1e-9, marks=LONG),
        pytest.param("shaping", "step, two parts, at 1 N", 73e-9, 1e-9, marks=LONG),
    ],
)
def test_what_no_bound_judges_is_as_known(
    name: str, what: str, known: float, within: float
) -> None:
    assert values_of(name)[what] == pytest.approx(known, abs=within)


# -- the verdicts


def test_a_verdict_follows_from_trends_and_numbers() -> None:
    for found, verdict in [
        ([(NUMBER, True)], ClaimVerdict.AGREES),
        ([(TREND, True), (NUMBER, True), (NOTHING, False)], ClaimVerdict.AGREES),
        ([(TREND, True)], ClaimVerdict.IN_KIND),
        ([(TREND, True), (NUMBER, True), (NUMBER, False)], ClaimVerdict.IN_KIND),
        ([(NUMBER, True), (NUMBER, False)], ClaimVerdict.IN_KIND),
        ([(TREND, True), (NUMBER, False)], ClaimVerdict.DISAGREES),
        ([(NUMBER, False)], ClaimVerdict.DISAGREES),
        ([(TREND, True), (TREND, False), (NUMBER, True)], ClaimVerdict.DISAGREES),
    ]:
        checks = [Check("x", 1.0 if h else -1.0, low=0.0, high=2.0, basis=b) for b, h in found]
        assert ClaimVerdict.of(checks) is verdict
    for number, holds in ((0.0, True), (2.0, True), (2.1, False), (-0.1, False), (math.nan, False)):
        assert Check("x", number, low=0.0, high=2.0).holds is holds


def test_each_value_has_a_check_and_both_sets_a_verdict() -> None:
    """What can be judged is judged, and what cannot says why."""
    x, y = Check("x", low=1.8, high=2.2, basis=NUMBER), Check("y", low=0.5, high=1.5)
    both = Result({"x": (3.0, 2.1), "y": 1.0}).judged([x, y])
    assert (both.verdict, both.joint_verdict) == (ClaimVerdict.DISAGREES, ClaimVerdict.AGREES)
    assert Result({"y": 1.0}).judged([y]).joint_verdict is None
    for found, check in ((Result({"y": 3.0}, settled=ClaimVerdict.DATA), y),
                         (Result({"y": 1.0}), Check("y", basis=NOTHING))):  # fmt: skip
        with pytest.raises(ValueError, match="either checks to judge"):
            found.judged([check])
    for checks in ([x], [x, y, Check("z")]):
        with pytest.raises(ValueError, match=r"no checks, or no values, of: [yz]"):
            Result({"x": 1.0, "y": 2.0}).judged(checks)


# -- the report


def good() -> Result:
    tables = {"": {"x (m)": np.array([1.0, np.nan])}, "_more": {"y (N)": np.array([0.1])}}
    return Result(
        {"steps < 3": (2.0e-9, 9e-9)}, tables, draw=draw, height=1.0,
        remark="<script>alert(1)</script>",
    )  # fmt: skip


def draw(figure: Figure) -> None:
    figure.add_subplot().plot([0, 1])


def bad() -> Result:
    raise ZeroDivisionError("no such law")


def item(name: str, compute: Callable[[], Result] = good) -> Claim:
    check = Check("steps < 3", 0.0, "m", "2 nm", 1e-9, 3e-9, NUMBER, why="within 50 %")
    return Claim(name, f"title of {name}", "Fig. 0", "it steps", "a drive", compute, [check])


@pytest.fixture
def executor() -> Iterator[Executor]:
    with ThreadPoolExecutor(2) as pool:
        yield pool


def test_the_page_shows_what_was_compared_and_needs_no_other_file(
    tmp_path: Path, executor: Executor
) -> None:
    out = tmp_path / "deep" / "out"
    report(out, [item("fig09")], executor)
    (outcome,) = report(out, [item("fig00")], executor)
    assert outcome.verdicts == "agrees; joint set disagrees"
    files = ["contents.txt", "fig00.csv", "fig00.png", "fig00.svg", "fig00_more.csv", PAGE]
    assert sorted(path.name for path in out.iterdir()) == files
    assert list(csv.reader((out / "fig00.csv").open())) == [["x (m)"], ["1.0"], [""]]
    text = (out / PAGE).read_text(encoding="utf-8")
    assert not re.search(r"<script|<iframe|url\(|@import|https?:", text)
    (image,) = re.findall(r'src="data:image/svg\+xml;base64,([^"]*)"', text)
    assert base64.b64decode(image) == (out / "fig00.svg").read_bytes()
    for shown in (
        '<section id="fig00">', "it steps", "a drive", "steps &lt; 3: 2.000 nm",
        "1 to 3 nm <small>(within 50 %)", "joint set: disagrees", "9.000 nm", "&lt;script&gt;",
    ):  # fmt: skip
        assert shown in text


def test_a_claim_that_fails_is_named_with_exit_code_1_and_spoils_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(command, "CLAIMS", (item("fig00", bad), item("fig01")))
    assert command.main(["--out", str(tmp_path / "out")]) == 1
    assert "paper: fig00 could not be computed: ZeroDivisionError: no such law" in (
        capsys.readouterr().err
    )
    assert "no such law" in (tmp_path / "out" / PAGE).read_text(encoding="utf-8")
    assert {path.name for path in tmp_path.glob("out/*.csv")} == {"fig01.csv", "fig01_more.csv"}


def test_a_folder_with_anything_of_others_is_refused_in_a_line(
    tmp_path: Path, executor: Executor, capsys: pytest.CaptureFixture[str]
) -> None:
    out, file = tmp_path / "out", tmp_path / "file"
    report(out, [item("fig00")], executor)
    (out / "notes.txt").write_text("mine", encoding="utf-8")
    file.write_text("mine", encoding="utf-8")
    before = {path: path.read_bytes() for path in (*out.iterdir(), file)}
    for place, words in (
        ((str(out),), "holds notes.txt, not part of an earlier report; choose another --out"),
        ((str(file),), "is not a folder"),
        ((str(tmp_path / "new"), "fig99"), "there is no ITEM 'fig99'; there are fig02"),
    ):
        assert command.main(["--out", *place]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert line.startswith("paper: ") and words in line
    assert {path: path.read_bytes() for path in (*out.iterdir(), file)} == before


def test_the_mistakes_are_those_of_the_documentation(tmp_path: Path, executor: Executor) -> None:
    """The documentation has the same table, line by line, and so has the page."""
    shipped = (Path(command.__file__).parent / "errata.md").read_text(encoding="utf-8")
    assert shipped in (ROOT / "docs" / "paper_errata.md").read_text(encoding="utf-8")
    assert {len(row) for row in errata()} == {4}
    report(tmp_path / "out", [], executor)
    text = (tmp_path / "out" / PAGE).read_text(encoding="utf-8")
    for shown in ("kN/mm2", "<code>config/</code>", "see Constants of the contact"):
        assert shown in text
