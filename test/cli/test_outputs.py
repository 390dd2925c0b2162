# SPDX-License-Identifier: Apache-2.0
"""What commands write and show: pictures, pages, tables, and progress bars."""

import csv
import fcntl
import json
import os
import pty
import struct
import subprocess
import sys
import termios
import webbrowser
from html.parser import HTMLParser
from pathlib import Path

import pytest

from stickslip_ros.cli.command_line import SUBCOMMANDS
from stickslip_ros.cli.main import main

BAG = str(Path(__file__).parents[1] / "golden" / "bags" / "everything")
#: Command, a text in its picture ("" for none), and a column or a name of its table.
COMMANDS = [
    (["simulate", "--steps", "3"], "time (ms)", "position (m)"),
    (["sweep", "--vary", "preload=0.5:1:2"], "step size (nm)", "preload (N)"),
    (["predict", "--step", "100nm"], "amplitude (V)", "zero_offset"),
    (["bag", "info", BAG], "time (ms)", "messages"),
    (["bag", "resimulate", BAG], "", "axis_slider position"),
    (["elongate", "--set", "frequency=10kHz"], "runner (nm)", "hold_before"),
    (
        ["identify-actuator", "actuator_loop.csv", "--out", "loop.yaml"],
        "voltage (V)",
        "parameters.gain",
    ),
    (["analyse", "steps_100hz.csv"], "step (nm)", "frequency (Hz)"),
]
#: Commands without a result that a picture, page or table could hold.
WITHOUT = {"explore", "bag", "send", "watch", "emulate", "demo", "warm-up"}


@pytest.mark.parametrize(("command", "drawn", "tabled"), COMMANDS)
def test_a_result_is_written_in_every_form(
    command: list[str],
    drawn: str,
    tabled: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    files = ["--report", "a.html", "--table", "a.csv", *(["--plot", "a.svg"] if drawn else [])]
    assert main([*command, *files, "--json"]) == 0
    json.loads(capsys.readouterr().out, parse_constant=pytest.fail)
    page = Path("a.html").read_text(encoding="utf-8")
    HTMLParser().feed(page)
    assert "<h1>" in page
    assert "http://" not in page.partition("<body>")[2].partition("data:image")[0]
    with Path("a.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.reader(file))
    assert tabled in {*rows[0], *(cell for row in rows for cell in row[:2])}
    assert len({len(row) for row in rows}) == 1
    if drawn:
        assert drawn in Path("a.svg").read_text(encoding="utf-8")
        assert main([*command, "--plot", "a.gif"]) == 2


@pytest.mark.parametrize("name", sorted(set(SUBCOMMANDS) - WITHOUT))
def test_every_other_command_has_the_options(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main([name, "--help"])
    text = capsys.readouterr().out
    wanted = ["--report", "--table", "--json", "--plot", "--show"]
    assert [option for option in wanted if f"{option} " not in text] == []


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


#: A part of the work that takes longer than people wait for a word
PROGRAM = """
import time
from stickslip_ros.cli.options import progress_bar
with progress_bar(2, "long work") as bar:
    time.sleep(2.5)
"""


def test_the_clock_of_a_bar_goes_on_during_a_long_part() -> None:
    screen, terminal = pty.openpty()
    fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
    with subprocess.Popen([sys.executable, "-c", PROGRAM], stderr=terminal) as process:
        os.close(terminal)
        shown = b""
        while True:
            try:
                shown += os.read(screen, 4096)
            except OSError:  # the other end is closed
                break
    os.close(screen)
    assert process.returncode == 0
    assert shown.count(b"long work:   0%") >= 2
    assert b"[00:01<" in shown
    assert b"[00:02<" in shown
