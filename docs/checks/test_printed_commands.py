# SPDX-License-Identifier: Apache-2.0
"""Every command that README and docs print: its options exist, and it does what it is printed for.

Commands of a line of code count, and those in running text. What stands in brackets is left out at
will by a user; here it is given.
"""

import re
import shlex
import shutil
from pathlib import Path

import pytest

from stickslip_ros.cli.command_line import SUBCOMMANDS, parser_for
from stickslip_ros.cli.main import main

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
SAMPLES = ROOT / "examples" / "samples"
_LINE = re.compile(r"^(?:    |\$ )(?:\.venv/bin/)?(stickslip .*)$", re.MULTILINE)
_INLINE = re.compile(r"`(stickslip [^`]+)`")

#: Files that a user has, and ours that stand for them.
STAND_FOR = {
    "run.csv": "steps_100hz.csv",
    "measured.csv": "steps_100hz.csv",
    "measurement.csv": "steps_100hz.csv",
    "bench/axis3.csv": "steps_100hz.csv",
    "loop.csv": "actuator_loop.csv",
    "LOOP.csv": "actuator_loop.csv",
}
#: What leaves the fitted parameters that other commands use.
IDENTIFY = [
    "identify", "--run", "table1_typical.yaml", "steps_100hz.csv", "--fit", "sigma_0ss,z_ba",
    "--out", "fitted.yaml",
]  # fmt: skip
#: Subcommands that are run by tests of their own, with what these need.
ELSEWHERE = {
    "bag", "demo", "emulate", "explore", "identify", "send", "twin", "warm-up", "watch",
}  # fmt: skip


def words(command: str) -> list[str]:
    """Return the arguments of a printed command, those in brackets included."""
    plain = re.sub(r"[\[\]]|\.\.\.", " ", command.split("|")[0])
    return shlex.split(plain, comments=True)[1:]


def printed(pattern: re.Pattern[str]) -> list[tuple[str, list[str]]]:
    """Return the page and the arguments of every command that is printed that way."""
    found = []
    for page in PAGES:
        for text in pattern.findall(page.read_text(encoding="utf-8")):
            arguments = words(" ".join(text.split()) if pattern is _INLINE else text)
            if not arguments[0].endswith(":"):  # a message of the command
                found.append((page.name, arguments))
    return found


LINES, INLINE = printed(_LINE), printed(_INLINE)
RUNNABLE = [
    (page, arguments)
    for page, arguments in [*LINES, *(one for one in INLINE if len(one[1]) > 1)]
    if arguments[0] not in ELSEWHERE
    # Forms, such as `analyse MEASUREMENT`, and a recorded run that only its own tests have.
    and not any(word.isupper() or word == "run" for word in arguments[1:])
]


def test_a_printed_publisher_waits_for_the_axis_and_for_its_answer() -> None:
    """`ros2 topic pub --once` alone lost one command of eight on a busy machine."""
    lines = [line for page in PAGES for line in page.read_text(encoding="utf-8").splitlines()]
    sent = [shlex.split(line) for line in lines if line.startswith("    ros2 topic pub ")]
    assert len(sent) >= 2
    for given in sent:
        waits, stays = (given[given.index(option) + 1] for option in ("-w", "--keep-alive"))
        assert int(waits) >= 1 <= float(stays), given


def test_a_printed_line_is_understood() -> None:
    assert min(len(LINES), len(INLINE)) > 20 and len(RUNNABLE) > 5
    for page, arguments in LINES:
        parsed = parser_for(arguments).parse_args(arguments)
        assert vars(parsed)["command"] == arguments[0], page


def test_a_command_in_the_text_is_understood(capsys: pytest.CaptureFixture[str]) -> None:
    """Such as `stickslip compare`, which leaves out what it compares."""
    for page, arguments in INLINE:
        if arguments in (["--version"], ["--help"]):
            continue
        assert arguments[0] in SUBCOMMANDS, page
        try:
            parser_for(arguments).parse_args(arguments)
        except SystemExit as end:
            said = capsys.readouterr().err
            assert end.code in (0, None) or "arguments are required" in said, (page, arguments)


@pytest.mark.parametrize(("page", "arguments"), RUNNABLE, ids=str)
def test_a_printed_command_runs_in_a_fresh_folder(
    page: str, arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, sample in STAND_FOR.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        shutil.copy(SAMPLES / sample, tmp_path / name)
    shutil.copy(ROOT / "config" / "table1_typical.yaml", tmp_path / "model.yaml")
    monkeypatch.chdir(tmp_path)
    if "fitted.yaml" in arguments:
        assert main(IDENTIFY) == 0
    try:
        code = main(arguments)
    except SystemExit as end:
        code = int(end.code or 0)
        assert code == 0 or len(arguments) < 3, arguments  # a form, with its arguments left out
        return
    assert code == 0
    for written in (arguments[k + 1] for k, word in enumerate(arguments) if word == "--out"):
        assert (tmp_path / written).is_file()
