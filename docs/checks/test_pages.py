# SPDX-License-Identifier: Apache-2.0
"""Pages say what there is: rooms, commands, constants, topics, public names, tests of security.

What takes long, running what the pages print, is in the files beside this one.
"""

import re
import runpy
from dataclasses import replace
from pathlib import Path

import public_api
import pytest
from table_1 import TABLE_1

import stickslip_ros as ss
from stickslip_ros.axis.commands import COMMANDS
from stickslip_ros.physics.parameters import PARAMETERS

ROOT = Path(__file__).parents[2]
SCRIPT = runpy.run_path(str(ROOT / "docs" / "architecture.py"))
TABLES = runpy.run_path(str(ROOT / "docs" / "tables.py"))


def test_the_picture_of_the_rooms_is_current() -> None:
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    assert page == SCRIPT["drawn"](ROOT / "stickslip_ros"), "run python docs/architecture.py"


def test_a_command_without_a_row_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(COMMANDS, "new", replace(COMMANDS["steps"], name="new"))
    assert {
        "docs/states.md: run python docs/tables.py",
        "docs/node.md: run python docs/tables.py",
    } <= set(TABLES["findings"]())


def test_a_changed_default_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    changed = {**PARAMETERS, "publish_rate": replace(PARAMETERS["publish_rate"], default=50.0)}
    monkeypatch.setitem(TABLES["findings"].__globals__, "PARAMETERS", changed)
    assert "docs/node.md: run python docs/tables.py" in TABLES["findings"]()


def test_the_page_of_the_law_has_the_values_of_table_1() -> None:
    page = (ROOT / "docs" / "friction.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| \$[^|]+\$ \| `(\w+)` \| (\S+) ?(.*) \|$", page, re.MULTILINE)
    assert len(rows) >= 12
    for name, value, unit in rows:
        assert float(value) == pytest.approx(TABLE_1[name])
        assert unit == PARAMETERS[name].unit


def test_the_page_on_the_node_names_what_there_is() -> None:
    """The parameters of the node stand in docs/node.md; its topics are written there."""
    topics = pytest.importorskip("stickslip_ros.ros.nodes.topics")
    page = (ROOT / "docs" / "node.md").read_text(encoding="utf-8")
    assert [topic for topic in topics.OUTPUTS if f"\n| `{topic}` |" not in page] == []
    for name in ("axes", "publish_rate", "real_time_factor", "real_time_priority", "publish_clock"):
        assert f"`{name}`" in page


#: Public names that docs/api.md only mentions: data, and what needs ROS.
MENTIONED = {"CONTROLLERS", "LAWS", "PARAMETERS", "WAVEFORMS", "AxisClient", "AxisFault"}


def test_every_public_name_is_on_its_page() -> None:
    text = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    listed = re.findall(r"^\.\. auto\w+:: stickslip_ros\.(\w+)$", text, re.MULTILINE)
    assert sorted(listed) == sorted(set(ss.__all__) - MENTIONED)
    assert [name for name in MENTIONED if f"`{name}`" not in text] == []


SECURITY = (ROOT / "SECURITY.md").read_text(encoding="utf-8")


def test_every_test_that_security_names_is_there() -> None:
    named = re.findall(r"`([\w/]*test_\w+\.py)(?:::(\w+))?`", SECURITY)
    assert len(named) > 30
    for file, test in named:
        (found,) = (one for one in (ROOT / "test", ROOT / "validation") if (one / file).is_file())
        text = (found / file).read_text(encoding="utf-8")
        assert f"def {test}(" in text or not test, (file, test)


def test_every_row_of_security_but_of_what_is_trusted_names_a_test() -> None:
    rows = [line for line in SECURITY.splitlines() if line.startswith("| ") and "---" not in line]
    heads = ("| input |", "| a peer cannot |", "| fault |")
    for row in rows:
        trusted = row.split("|")[2].strip() == "yes"
        assert ".py::test_" in row or trusted or row.startswith(heads), row


def unnamed(recorded: set[str], now: set[str], changelog: str) -> list[str]:
    """Return the public names that have changed and that a changelog does not name.

    Of what comes or goes as a whole the name itself is enough; else the member has to be named.
    """
    wanted = set()
    for line in recorded ^ now:
        name = line.partition("(")[0]
        whole = name.partition(".")[0]
        others = recorded if line in now else now
        kept = any(re.split(r"[(.]", other)[0] == whole for other in others)
        wanted.add((name if kept else whole).partition(":")[2])
    return sorted(name for name in wanted if not re.search(rf"\b{re.escape(name)}\b", changelog))


def test_what_changed_since_the_last_release_is_in_the_changelog() -> None:
    """The record is that of the release; `python docs/checks/public_api.py` renews it."""
    pytest.importorskip("rclpy")
    text = (ROOT / "CHANGELOG.rst").read_text(encoding="utf-8")
    forthcoming = re.split(r"\n(?=\d+\.\d+\.\d+ \(\d)", text)[0]
    assert (
        unnamed(
            {*public_api.RECORD.read_text("utf-8").split("\n")} - {""},
            {*public_api.surface()},
            forthcoming,
        )
        == []
    )
