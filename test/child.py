# SPDX-License-Identifier: Apache-2.0
"""Programs that import this checkout, in processes of their own."""

import os
import shutil
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parent.parent
PATIENCE = 300.0  # s, for a process on a busy machine


def environment(**changes: str) -> dict[str, str]:
    """Return the environment of a child that imports this checkout and buffers as usual."""
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    places = REPOSITORY, REPOSITORY / "test", os.environ.get("PYTHONPATH")
    path = os.pathsep.join(str(place) for place in places if place)
    return {**kept, "PYTHONPATH": path, **changes}


def python(
    *arguments: str, cwd: Path | str | None = None, **changes: str
) -> subprocess.CompletedProcess[str]:
    """Run Python with arguments and changes of the environment; return what it said."""
    return run(sys.executable, *arguments, cwd=cwd, **changes)


def run(
    *command: str, cwd: Path | str | None = None, **changes: str
) -> subprocess.CompletedProcess[str]:
    """Run a program with changes of the environment; return what it said."""
    return subprocess.run(
        command,
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        cwd=cwd,
        env=environment(**changes),
    )


def stickslip(
    *words: str, cwd: Path | None = None, code: int = 0, changes: Mapping[str, str] | None = None
) -> str:
    """Run a command of the package, which has to end with a code; return what it said.

    That is on stdout, and where it refuses (2 and above) on stderr. changes are those of the
    environment.
    """
    done = python("-m", "stickslip_ros", *words, cwd=cwd, **(changes or {}))
    assert done.returncode == code, done.stdout + done.stderr
    assert "Traceback" not in done.stderr
    return done.stdout if code < 2 else done.stderr


def complaints(stderr: str) -> str:
    """Return what a program said on stderr, but that some work takes long on a busy machine."""
    return "".join(line for line in stderr.splitlines(True) if not line.endswith(" ...\n"))


def in_namespace(
    kind: str, prepare: str, script: str, *arguments: str
) -> subprocess.CompletedProcess[str]:
    """Run a shell script in a namespace (mount, net) of its own, once that has been prepared.

    The test is skipped where that is not allowed.
    """
    unshare = shutil.which("unshare") or pytest.skip("no unshare on this machine")
    flags = [f"--{kind}"] if os.geteuid() == 0 else [f"--{kind}", "--map-root-user"]
    if run(unshare, *flags, "true").returncode:
        pytest.skip(f"no namespace for {kind} is allowed here")
    done = run(unshare, *flags, "sh", "-c", f"{prepare} || exit 99\n{script}", *arguments)
    if done.returncode == 99:
        pytest.skip(f"not possible in a namespace here: {done.stderr}")
    return done
