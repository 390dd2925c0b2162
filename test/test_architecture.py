# SPDX-License-Identifier: Apache-2.0
"""The pages that describe the code: the picture of the rooms, and the friction law's constants."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import pytest

from stickslip_ros.model import LAWS
from stickslip_ros.parameters import PARAMETERS

ROOT = Path(__file__).parent.parent
SCRIPT = runpy.run_path(str(ROOT / "docs" / "architecture.py"))


def test_the_picture_of_the_rooms_is_current() -> None:
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    assert page == SCRIPT["drawn"](ROOT / "stickslip_ros"), "run python docs/architecture.py"


def test_arrows_are_read_from_imports(tmp_path: Path) -> None:
    texts = {
        "top": "from stickslip_ros.middle import x\nfrom stickslip_ros import bottom",
        "middle": "import stickslip_ros.bottom.y",
        "bottom": "def f():\n    from stickslip_ros.side import z",
        "side": "import numpy",
    }
    for room, text in texts.items():
        (tmp_path / room).mkdir()
        (tmp_path / room / "__init__.py").write_text(text, encoding="utf-8")
    lines = re.findall(r"\w+ -[.-]+> \w+", SCRIPT["drawn"](tmp_path))
    assert lines == ["middle --> bottom", "top --> middle", "bottom -.-> side"]


def test_the_page_of_the_law_has_the_defaults_and_every_law() -> None:
    page = (ROOT / "docs" / "friction.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| \$[^|]+\$ \| `(\w+)` \| (\S+) ?(.*) \|$", page, re.MULTILINE)
    assert len(rows) >= 12
    for name, value, unit in rows:
        assert float(value) == pytest.approx(PARAMETERS[name].default)
        assert unit == PARAMETERS[name].unit
    assert set(re.findall(r"^\| `(\w+)` \(", page, re.MULTILINE)) == set(LAWS)
