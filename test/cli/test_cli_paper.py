# SPDX-License-Identifier: Apache-2.0
"""``stickslip paper`` where an item fails; the whole is journey 6."""

from pathlib import Path

import pytest

from stickslip_ros import paper
from stickslip_ros.cli.main import main


def test_an_item_that_fails_is_named_with_exit_code_1(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail() -> paper.Result:
        raise ValueError("no such law")

    broken = paper.Claim("fig99", "broken", "Fig. 99", "it steps", "a drive", fail, ())
    monkeypatch.setattr(paper, "CLAIMS", (broken,))
    assert main(["paper", "--out", str(tmp_path / "report")]) == 1
    assert "stickslip paper: fig99 could not be computed: ValueError: no such law" in (
        capsys.readouterr().err
    )
    assert "no such law" in (tmp_path / "report" / "index.html").read_text(encoding="utf-8")
