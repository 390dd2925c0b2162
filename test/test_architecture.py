# SPDX-License-Identifier: Apache-2.0
"""Pages that follow from the code: picture of the rooms, tables of commands, constants."""

import re
import runpy
from dataclasses import replace
from pathlib import Path

import pytest
from table_1 import TABLE_1

from stickslip_ros.axis.commands import COMMANDS
from stickslip_ros.parameters import PARAMETERS

ROOT = Path(__file__).parent.parent
SCRIPT = runpy.run_path(str(ROOT / "docs" / "architecture.py"))
TABLES = runpy.run_path(str(ROOT / "docs" / "tables.py"))


@pytest.mark.slow
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
