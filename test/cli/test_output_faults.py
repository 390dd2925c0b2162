# SPDX-License-Identifier: Apache-2.0
"""Every file and folder that a command writes: each call of the system fails once, in turn.

Then the exit code is 2, one line names the file, the reason and the cure, and nothing is left; or
the call does not matter, and the result is whole. A real full disk and a missing home follow.
"""

import contextlib
import io
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from bags import record
from child import complaints, in_namespace, run
from file_layer import FileLayer, each_fault

from stickslip_ros.cli.main import main

ROOT = Path(__file__).resolve().parents[2]
COMMAND = (sys.executable, "-m", "stickslip_ros.cli.main")
SIMULATE = ("simulate", "--steps", "2", "--frequency", "1000")


#: Name of what is written, and the command line before it.
OUTPUTS: dict[str, tuple[str, ...]] = {
    "trace.csv": (*SIMULATE, "--trace"),
    "sweep.csv": ("sweep", "--vary", "preload=0.5:1:2", "--metric", "step_size", "--out"),
    "loop.yaml": ("identify-actuator", f"{ROOT}/examples/samples/actuator_loop.csv", "--out"),
    "recovered": ("bag", "recover", "BAG", "--out"),
    "elongated.yaml": ("elongate", "--out"),
}


class Command:
    """A command line whose results go to another place each time."""

    def __init__(self, name: str, words: tuple[str, ...], bag: Path) -> None:
        self._words = [str(bag) if word == "BAG" else word for word in words]
        self.name = name
        self.code, self.said = 0, ""

    def run(self, _: FileLayer | None, place: Path, *more: str) -> None:
        """Run it; keep its exit code and what it said on stderr."""
        said = io.StringIO()
        with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
            self.code = main([*self._words, str(place / self.name), *more])
        self.said = said.getvalue()


def content(path: Path) -> dict[str, int]:
    """Return the files of a result and their sizes."""
    files = [path] if path.is_file() else [file for file in path.rglob("*") if file.is_file()]
    return {str(file.relative_to(path)): file.stat().st_size for file in files}


@pytest.mark.parametrize("name", OUTPUTS)
def test_every_call_fails_once(tmp_path: Path, name: str) -> None:
    command = Command(name, OUTPUTS[name], tmp_path / "small")
    record(tmp_path / "small", 20)
    whole = tmp_path / "whole"
    whole.mkdir()
    command.run(None, whole)
    good, expected = command.code, content(whole / name)
    assert good in (0, 1), command.said  # 1: something was found, which is no fault
    assert expected
    failed = set()
    (tmp_path / "faults").mkdir()
    for call, raised, place in each_fault(command.run, tmp_path / "faults"):
        assert raised is None, f"{call}: {raised!r}"
        if command.code == good:
            assert call.startswith(("unlink", "rmdir")), call
            assert set(content(place / name)) == set(expected), call
            continue
        failed.add(call.split()[0])
        assert command.code == 2, call
        assert command.said.count("\n") == 1, command.said
        assert name in command.said
        assert "No space left on device; make room on the disk" in command.said, call
        if not call.startswith("fsync"):  # of the folder, after the file has its name
            assert list(place.iterdir()) == [], call
    assert {"open", "write"} <= failed
    assert "fsync" in failed


def test_a_real_full_disk(tmp_path: Path) -> None:
    """A file system of 8 kB, in a namespace of its own."""
    words = shlex.join([*COMMAND, *SIMULATE, "--trace", f"{tmp_path}/trace.csv"])
    disk = shlex.quote(str(tmp_path))
    mount = f"mount -t tmpfs -o size=8k tmpfs {disk}"
    done = in_namespace("mount", mount, f"{words}; code=$?; ls -A {disk}; exit $code")
    assert done.returncode == 2
    assert "trace.csv: No space left on device; make room on the disk" in done.stderr
    assert done.stdout.split()[-1:] != ["trace.csv"]
    assert ".part" not in done.stdout


def test_memory_that_runs_out_is_one_line() -> None:
    """Ten million steps take 0.8 GB at a time; 0.3 are allowed, of which Python has the most."""
    words = shlex.join([*COMMAND, "simulate", "--steps", "10000000", "--frequency", "1000"])
    done = run("sh", "-c", f"ulimit -d 300000; exec {words}")
    assert (done.returncode, done.stdout) == (2, "")
    assert complaints(done.stderr) == (
        "stickslip simulate: out of memory; ask for less at once, close other programs or raise "
        "the limit (ulimit -v)\n"
    )


def test_without_a_home_and_an_environment(tmp_path: Path) -> None:
    done = subprocess.run(
        [*COMMAND, *SIMULATE, "--trace", str(tmp_path / "trace.csv")],
        capture_output=True,
        text=True,
        env={"PYTHONPATH": str(ROOT), "HOME": "/proc/nowhere", "PATH": "/usr/bin:/bin"},
        cwd=tmp_path,
    )
    assert (done.returncode, complaints(done.stderr)) == (0, "")
    assert [path.name for path in tmp_path.iterdir()] == ["trace.csv"]
