# SPDX-License-Identifier: Apache-2.0
"""J6: every figure and table of the paper by one command, held against what the paper says.

The bounds of its checks are read from their table, and the verdicts made once more by their rule;
the steps behind them are those of a general integrator.
"""

import csv
import json
import re
from pathlib import Path

import numpy as np
import pytest
from child import REPOSITORY, python

from stickslip_ros.physics.parameters import Parameters, read_yaml
from validation.whole_system import positions

CHECKS = REPOSITORY / "validation" / "paper" / "checks.csv"
PAGE = (REPOSITORY / "docs" / "paper.md").read_text(encoding="utf-8")
#: Items that take many seconds, or share their work with one that does.
LONG = {"shaping", "fig04c", "fig06", "fig12", "fig15", "joint"}
#: The checks that a simulation misses, with Table 1 and, where another, with the joint set.
MISSED = {
    "tab01": ({"backstep", "vibration"}, set()),
    # No equation of the paper knows a rate.
    "fig07": ({f"depth of a minimum between the ends, {m}" for m in ("direct", "intersection")},),
    # The gain begins far below 10 kHz.
    "elongation": ({"longest step at 10 kHz", "lowest frequency of the curve with a gain of 1.4"},),
    # A third of the ringing is left.
    "fig08": ({f"{what}, very high over usual damping" for what in ("ringing", "backstep")},),
    "sec43": ({"motion in a cycle at 4 N, over that at 1 N"},),  # the runner sinks
    "fig09": ({"power of the modulus with which it grows"},),  # no proportionality
    # Eq. 13 and 14 depend on the preload.
    "fig13": ({"spread over preload 0.4 to 2 N, CEIM"},),
    "fig14": (
        {
            "preload at which this line reaches zero", "step at 5.5 N",
            "preload that blocks the drive",
        },
        {"step at 5.5 N", "preload that blocks the drive"},
    ),
    "fig15": (
        {"maximum, constant, at", "maximum, linear, at", "level, linear over constant"}, set(),
    ),
}  # fmt: skip
#: In the words of the page: what nothing in the paper judges, and the verdicts of docs/paper.md.
SETTLED = {"data only", "the paper contradicts itself"}


def rows_of(file: Path) -> list[dict[str, str]]:
    with file.open(newline="", encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


def verdict(checks: list[tuple[str, bool]]) -> str:
    """Return the verdict by the rule of docs/paper.md, from basis and result of each check."""
    trends = [holds for basis, holds in checks if basis == "trend"]
    numbers = [holds for basis, holds in checks if basis == "number"]
    if not all(trends) or (numbers and not any(numbers)):
        return "disagrees"
    return "agrees" if numbers and all(numbers) else "agrees in kind"


def documented() -> dict[str, str]:
    """Return the verdict of each claim with Table 1, as the page of the paper has it."""
    table = PAGE.partition("## As found")[2]
    found = re.findall(r"^\| (\w+) \| [^|]* \| ([^|]*) \|", table, re.MULTILINE)
    names = {name: said.partition(",")[0].partition(";")[0] for name, said in found}
    del names["claim"]
    return {name: "agrees in kind" if one == "in kind" else one for name, one in names.items()}


@pytest.mark.parametrize("whole", [False, pytest.param(True, marks=pytest.mark.long)])
def test_the_paper(whole: bool, tmp_path: Path) -> None:
    checks: dict[str, list[dict[str, str]]] = {}
    for row in rows_of(CHECKS):
        checks.setdefault(row["claim"], []).append(row)
    told = documented()
    names = [name for name in told if whole or name not in LONG]
    words = ("-m", "validation.paper", *([] if whole else names), "--out", "report", "--json")
    done = python(*words, cwd=tmp_path)
    assert done.returncode == 0, done.stderr

    # Each number within its bounds holds; the verdict follows from them, and the docs have it.
    numbers = json.loads(done.stdout)["numbers"]
    page = (tmp_path / "report" / "index.html").read_text(encoding="utf-8")
    for name in names:
        mine = [row for row in numbers if row["claim"] == name]
        missed: list[set[str]] = [set(), set()]
        judged = []
        for row, check in zip(mine, checks.get(name, mine), strict=True):
            if row["verdict"]:
                low, high = float(check["low"]), float(check["high"])
                joint = row["joint set"]
                both = row["simulated"], row["simulated"] if joint is None else joint
                held = [low <= value <= high for value in both]
                assert row["verdict"] == ("holds" if held[0] else "does not hold")
                judged.append((check["basis"], held[0]))
                for one, holds in zip(missed, held, strict=True):
                    one |= set() if holds else {row["quantity"]}
        assert missed == [MISSED.get(name, (set(),))[k] for k in (0, -1)], name
        if told[name] not in SETTLED:
            assert told[name] == verdict(judged), name
        section = page.partition(f'<section id="{name}">')[2].partition("</section>")[0]
        assert re.findall(r'<span class="badge[^"]*">([^<]*)<', section)[:1] == [told[name]], name
        if told[name] in ("disagrees", "the paper contradicts itself"):
            assert "Cause:" in section or "The paper&#39;s own numbers" in section

    # Pictures, and the data behind them with units.
    tables = list((tmp_path / "report").glob("*.csv"))
    assert len(tables) >= len(names) - 3
    for table in tables:
        first, *rows = csv.reader(table.open(newline="", encoding="utf-8"))
        assert rows and {len(row) for row in rows} == {len(first)}
        assert table.stem == "joint" or any("(" in name for name in first), table
    pictures = {file.stem for file in (tmp_path / "report").glob("*.svg")}
    assert pictures >= {name for name in names if name.startswith("fig") and name != "fig11"}

    # By an integrator of others, with Table 1 and with the joint set that is shipped.
    (step,) = [row for row in numbers if (row["claim"], row["quantity"]) == ("tab01", "step size")]
    joint = read_yaml(REPOSITORY / "config" / "paper_joint_set.yaml")
    for p, said in ((Parameters(), "simulated"), (joint, "joint set")):
        made = np.diff(positions(p, 12))[-3:].mean()
        assert step[said] == pytest.approx(made, abs=0.02e-9)


def test_the_page_counts_its_verdicts() -> None:
    count = list(documented().values()).count
    found = re.search(
        r"Of the (\d+) claims, (\d+) agree, (\d+) agree in kind, (\d+) disagree", PAGE
    )
    assert found
    words = ("agrees", "agrees in kind", "disagrees")
    assert [int(one) for one in found.groups()] == [len(documented()), *map(count, words)]
