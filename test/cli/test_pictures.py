# SPDX-License-Identifier: Apache-2.0
"""Pictures that commands write by --plot and open by --show."""

import webbrowser
from pathlib import Path

import pytest

from stickslip_ros.cli.main import main

BAG = Path(__file__).parents[1] / "golden" / "bags" / "everything"


@pytest.mark.parametrize(
    ("command", "axis_name"),
    [(["predict", "--step", "100nm"], "amplitude (V)"), (["bag", "info", str(BAG)], "time (ms)")],
)
def test_a_picture_is_written(command: list[str], axis_name: str, tmp_path: Path) -> None:
    picture = tmp_path / "picture.svg"
    assert main([*command, "--plot", str(picture)]) == 0
    assert axis_name in picture.read_text()
    assert main([*command, "--plot", str(tmp_path / "picture.gif")]) == 2


def test_a_picture_is_shown(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    opened: list[str] = []
    monkeypatch.setattr(webbrowser, "open", opened.append)
    picture = tmp_path / "steps.png"
    assert main(["predict", "--plot", str(picture), "--show"]) == 0
    assert opened == [picture.as_uri()]
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    assert main(["predict", "--show"]) == 0
    (written,) = tmp_path.glob("stickslip-*/picture.png")
    assert opened[1:] == [written.as_uri()]
    assert main(["predict", "--amplitude", "-5V", "--show"]) == 2
    assert len(opened) == 2
