# SPDX-License-Identifier: Apache-2.0
"""The example of docs/testing.md, taken out of the page and run as a user runs it."""

import re
from pathlib import Path

import pytest
from live import Start

from stickslip_ros.ros.topics import OUTPUTS

DOCS = Path(__file__).resolve().parent.parent.parent / "docs"


@pytest.mark.long
def test_the_example_for_users_passes(start_module: Start, tmp_path: Path) -> None:
    page = (DOCS / "testing.md").read_text(encoding="utf-8")
    (example,) = re.findall(r"^```python\n(.*?)^```$", page, re.DOTALL | re.MULTILINE)
    (tmp_path / "test_stage.py").write_text(example)
    run = start_module(
        "pytest",
        "-q",
        "-p",
        "stickslip_ros.testing.plugin",
        "-p",
        "no:cacheprovider",
        "test_stage.py",
    )
    run.wait_for("2 passed", timeout=60.0)
    assert run.wait() == 0


def test_the_page_on_the_node_names_what_there_is() -> None:
    """The parameters of the node stand in docs/node.md; its topics are written there."""
    page = (DOCS / "node.md").read_text(encoding="utf-8")
    assert [topic for topic in OUTPUTS if f"\n| `{topic}` |" not in page] == []
    for name in ("axes", "publish_rate", "real_time_factor", "real_time_priority", "publish_clock"):
        assert f"`{name}`" in page
