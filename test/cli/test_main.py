# SPDX-License-Identifier: Apache-2.0
"""The command ``stickslip`` as a whole: help, bad use, pipes, Ctrl-C."""

import fcntl
import json
import os
import pty
import re
import signal
import struct
import subprocess
import sys
import termios
from pathlib import Path

import pytest
from child import PATIENCE, complaints, environment, python

from stickslip_ros.cli.command_line import SUBCOMMANDS
from stickslip_ros.cli.main import main
from stickslip_ros.version import __version__

COMMAND = (sys.executable, "-m", "stickslip_ros.cli.main")


def stickslip(*arguments: str, **changes: str) -> subprocess.CompletedProcess[str]:
    """Run the real command line, outside the checkout's folder."""
    return python("-m", "stickslip_ros.cli.main", *arguments, cwd="/", **changes)


def test_help_names_every_subcommand_and_each_has_its_own(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """What the help lists can be asked for help in turn."""
    with pytest.raises(SystemExit) as end:
        main(["--help"])
    assert end.value.code == 0
    listed = re.findall(r"^    (\w+) +\w", capsys.readouterr().out, re.MULTILINE)
    assert {"simulate", "demo"} <= set(listed)
    for name in listed:
        with pytest.raises(SystemExit) as end:
            main([name, "--help"])
        assert end.value.code == 0
        assert f"usage: stickslip {name}" in capsys.readouterr().out


def test_bad_use_ends_with_2_and_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    """Which names the nearest name to a misspelt one, and where something has moved."""
    for arguments, said in [
        ("", "see stickslip --help"),
        ("dance", "see stickslip --help"),
        ("simulate --steps 1e3", "see stickslip simulate --help"),
        ("bag", "see stickslip bag --help"),
        ("simulte", "did you mean 'simulate'?"),
        ("bag inof", "did you mean 'info'?"),
        ("identify-actuatr", "did you mean 'identify-actuator'?"),
        ("emulate anc350", "did you mean 'anc300'?"),
        ("emulate ANC300", "did you mean 'anc300'?"),
        ("bench --json", "bench has moved: make bench"),
        ("soak --json", "soak has moved: make soak"),
        ("simulate --frequency 1,5kHz", "'1,5kHz' has a comma; write 1.5 with a point"),
    ]:
        with pytest.raises(SystemExit) as end:
            main(arguments.split())
        assert end.value.code == 2
        output = capsys.readouterr()
        assert output.out == ""
        (line,) = output.err.splitlines()
        assert line.startswith("stickslip") and said in line, line


def test_the_package_runs_as_a_module() -> None:
    assert python("-m", "stickslip_ros", "--version").stdout.strip() == __version__


def test_files_of_the_package_are_found_from_anywhere(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir("/")
    for command in ("simulate --config", "compare", "identify --run"):
        sample = [] if command.startswith("simulate") else ["steps_100hz.csv"]
        assert main([*command.split(), "table1_vibrations.yaml", *sample]) == 2
        assert "did you mean table1_vibration.yaml?" in capsys.readouterr().err
    assert main(["compare", "table1_typical.yaml", "steps_100hz.csv"]) == 0
    assert "step size" in capsys.readouterr().out


def test_a_negative_number_is_no_option(capsys: pytest.CaptureFixture[str]) -> None:
    """In whatever way it is written: it gets to where its limits are told."""
    for number in ("-1e-3", "-1.5E+3", "-.5", "-2", "-inf"):
        assert main(["simulate", "--amplitude", number]) == 2
        assert f"amplitude is {float(number):g}" in capsys.readouterr().err


def test_it_works_without_ros() -> None:
    """Neither the help nor a simulation may load a ROS package."""
    block = (
        "import sys\n"
        "for name in ('rclpy', 'std_msgs', 'sensor_msgs'): sys.modules[name] = None\n"
        "from stickslip_ros.cli.main import main\n"
        "main(['simulate', '--steps', '2'])\n"
        "sys.exit(main(['demo', '--out', '/nonexistent']))\n"
    )
    child = python("-c", block)
    assert "step size" in child.stdout
    assert child.returncode == 2
    assert "stickslip demo: needs ROS 2: source it or use `make demo`" in child.stderr


@pytest.mark.parametrize(
    ("arguments", "unbuffered"),
    [
        ("simulate --steps 2000 --json", ""),
        pytest.param("simulate --steps 2000 --json", "1", marks=pytest.mark.long),
        ("--help", ""),
    ],
)
def test_a_reader_that_goes_away_is_no_error(arguments: str, unbuffered: str) -> None:
    """As with ``| head -1``: nothing on stderr, and no failure for ``set -o pipefail``.

    The reading end is closed before the program writes, so that the pipe is broken for sure.
    """
    reading, writing = os.pipe()
    child = subprocess.Popen(
        [*COMMAND, *arguments.split()],
        stdout=writing,
        stderr=subprocess.PIPE,
        text=True,
        env=environment(PYTHONUNBUFFERED=unbuffered),
    )
    os.close(writing)
    os.close(reading)
    _, errors = child.communicate(timeout=PATIENCE)
    assert complaints(errors) == ""
    assert child.returncode == 0


ENDLESS = """
import sys
from stickslip_ros.simulation import steps
from stickslip_ros.cli.main import main
once = steps.run_steps
def endless(p, steps, *progress):
    while steps > 1:
        once(p, steps, *progress)
steps.run_steps = endless
sys.exit(main(["simulate", "--steps", "10000000"]))
"""


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no full device")
def test_a_full_disk_below_the_output_is_one_line() -> None:
    with open("/dev/full", "w", encoding="utf-8") as full:
        child = subprocess.run(
            [*COMMAND, "simulate", "--steps", "2", "--json"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            env=environment(),
            timeout=PATIENCE,
        )
    text = "stickslip: the output cannot be written: No space left on device\n"
    assert (child.returncode, complaints(child.stderr)) == (2, text)


@pytest.mark.parametrize(
    "number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.long)]
)
def test_a_signal_ends_long_work_at_once_with_130(number: signal.Signals) -> None:
    """On a terminal, where the progress bar shows when the work is under way.

    However fast the solver is: the work begins again until it is interrupted.
    """
    master, slave = pty.openpty()
    fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
    child = subprocess.Popen(
        [sys.executable, "-c", ENDLESS], stdin=slave, stdout=slave, stderr=slave, env=environment()
    )
    os.close(slave)
    try:
        said = b""
        while b"steps:" not in said:
            said += os.read(master, 1000)
        child.send_signal(number)
        assert child.wait(PATIENCE) == 130
        while (more := _read(master)) != b"":
            said += more
    finally:
        child.kill()
        child.wait()
        os.close(master)
    assert b"stickslip simulate: interrupted" in said
    assert b"Traceback" not in said


LOADING = """
import builtins, signal, sys
from stickslip_ros.cli.main import main
genuine = builtins.__import__
def interrupted(name, *rest):
    if name == sys.argv[1]:
        signal.raise_signal(signal.SIGINT)
    return genuine(name, *rest)
builtins.__import__ = interrupted
sys.exit(main(["simulate"]))
"""


IGNORING = """
import signal, sys, time
from stickslip_ros.simulation import steps
from stickslip_ros.cli.main import main
class Deaf:
    def __del__(self):
        signal.raise_signal(signal.SIGINT)
def endless(*_):
    Deaf()
    while True:
        time.sleep(0.01)
steps.run_steps = endless
sys.exit(main(["simulate"]))
"""


def test_a_signal_that_a_destructor_swallows_comes_again() -> None:
    """Some that came while numba loaded compiled code were lost, and the command went on."""
    child = python("-c", IGNORING)
    said = complaints(child.stderr)
    assert (child.returncode, said) == (130, "stickslip simulate: interrupted\n")


def test_a_quantity_takes_its_unit_wherever_one_is_typed(
    capsys: pytest.CaptureFixture[str],
) -> None:
    common = ["simulate", "--steps", "3", "--json"]
    assert main([*common, "--frequency", "1kHz", "--amplitude", "200V", "--set", "mass=3g"]) == 0
    with_units = json.loads(capsys.readouterr().out)
    assert main([*common, "--frequency", "1000", "--amplitude", "200", "--set", "mass=0.003"]) == 0
    assert json.loads(capsys.readouterr().out) == with_units


@pytest.mark.parametrize(
    ("loaded", "who"),
    [
        ("stickslip_ros.physics.parameters", "stickslip"),
        ("stickslip_ros.simulation.steps", "stickslip simulate"),
    ],
)
def test_ctrl_c_while_it_loads_ends_as_later(loaded: str, who: str) -> None:
    """The options, or what computes, which takes a second."""
    child = python("-c", LOADING, loaded)
    assert child.returncode == 130
    assert complaints(child.stderr) == f"{who}: interrupted\n"


def _read(terminal: int) -> bytes:
    try:
        return os.read(terminal, 1000)
    except OSError:  # how Linux says that nobody writes any more
        return b""


#: A command of each kind of output that needs no ROS and little time.
_SPEAKING = (
    "simulate --steps 3",
    "simulate --list-parameters",
    "sweep --vary preload=0.3:6:3 --metric step_size",
    "analyse steps_100hz.csv",
    "compare table1_typical.yaml steps_100hz.csv --set preload=1.0",
    "identify-actuator actuator_loop.csv --out loop.yaml",
    "shape --set preload=0.4",
    "explore --port 70000",
)


@pytest.mark.long
@pytest.mark.parametrize("encoding", ["cp1252", "ascii"])
def test_nothing_that_is_printed_needs_unicode(encoding: str, tmp_path: Path) -> None:
    """As on a console of Windows, or without a locale: no traceback, and no question marks."""
    commands = [f"{name} --help" for name in SUBCOMMANDS] + list(_SPEAKING)
    program = (
        "from stickslip_ros.cli.main import main\n"
        f"for text in {commands!r}:\n"
        "    print('#', text)\n"
        "    try:\n"
        "        code = main(text.split())\n"
        "    except SystemExit as end:\n"
        "        code = end.code or 0\n"
        "    assert code == (2 if '70000' in text else 0), (text, code)\n"
    )
    found = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True, timeout=300, cwd=tmp_path,
        env=environment(PYTHONIOENCODING=encoding, PYTHONUTF8="0"),
    )  # fmt: skip
    assert found.returncode == 0, found.stderr.decode(errors="replace")
    text = found.stdout.decode(encoding)
    assert "DIFFERS" in text
    assert re.search(r" -\d[\d.]* nm ", text)  # where UTF-8 has U+2212
    assert "?" not in re.sub(r"[\w)]\?[ \n]", "", text)  # questions that helps ask
