# SPDX-License-Identifier: Apache-2.0
"""``make bench``: what it prints and writes, and what it refuses. No times are judged."""

import importlib
import json
import re
import runpy
from pathlib import Path
from typing import Any

import pytest
import setuptools

from validation import benchmark
from validation.benchmark import LIMIT, Effort
from validation.benchmark.__main__ import main

REPOSITORY = Path(__file__).resolve().parent.parent.parent
#: Peers that are always there, one case: short enough for a test.
SHORT = ("--quick", "--cases", "0.4N-18500Hz", "--methods", "scipy-odeint")


@pytest.fixture(autouse=True)
def hurried(monkeypatch: pytest.MonkeyPatch) -> None:
    """Measure as little as possible."""
    effort = Effort(cycles=2, repeats=2, quoted=1e-4, plotted=1e-4)
    monkeypatch.setattr(benchmark, "QUICK", effort)


@pytest.mark.slow
def test_a_table_and_a_picture(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "speed.png"
    assert main([*SHORT, "--plot", str(path)]) == 0
    out, err = capsys.readouterr()
    assert re.search(r"^stickslip_ros\s+\S+\s+\d", out, re.MULTILINE)
    assert re.search(r"^SciPy odeint\s+\S+\s+\d", out, re.MULTILINE)
    assert "CyRK" not in out  # was not asked for
    assert "fastest peer" in out
    assert err == ""  # no bar where there is no terminal
    assert path.read_bytes().startswith(b"\x89PNG")


def test_one_json_object(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*SHORT, "--json"]) == 0
    (case,) = json.loads(capsys.readouterr().out)["cases"]
    assert [one["name"] for one in case["methods"]] == ["ours", "scipy-odeint"]
    assert case["methods"][0]["quoted"]["error"] <= LIMIT


def test_a_missing_peer_is_named_and_spoils_nothing(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    normal = importlib.import_module

    def no_cyrk(name: str, package: str | None = None) -> Any:
        if name == "CyRK":
            raise ModuleNotFoundError(f"No module named {name!r}")
        return normal(name, package)

    monkeypatch.setattr("importlib.import_module", no_cyrk)
    assert main([*SHORT, "cyrk-dop853"]) == 0
    out = capsys.readouterr().out
    assert re.search(r"^CyRK DOP853\s+missing: not installed: pip install cyrk", out, re.MULTILINE)
    assert re.search(r"^SciPy odeint\s+\S+\s+\d", out, re.MULTILINE)


@pytest.mark.parametrize(
    "arguments", [("--cases", "0.4N-7Hz"), ("--methods", "cyrk-magic"), ("--methods", "ours")]
)
def test_unknown_names_are_refused(
    arguments: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as refused:
        main([*arguments])
    assert refused.value.code == 2
    assert "invalid choice" in capsys.readouterr().err


def test_a_picture_that_cannot_be_written_is_refused_before_any_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*SHORT, "--plot", str(tmp_path / "nowhere" / "speed.png")]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert "make its folder first" in err


def test_help_says_how_long_it_takes(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["--help"])
    assert "minutes" in capsys.readouterr().out


def test_make_installs_the_peers_of_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    handed: dict[str, Any] = {}
    monkeypatch.chdir(REPOSITORY)
    monkeypatch.setattr(setuptools, "setup", handed.update)
    runpy.run_path("setup.py")
    listed = re.search(r"^PEERS := (.*)$", Path("Makefile").read_text("utf-8"), re.MULTILINE)
    assert listed
    assert listed[1].split() == handed["extras_require"]["bench"]
