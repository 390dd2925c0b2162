# SPDX-License-Identifier: Apache-2.0
"""The first start on a machine, which compiles the solver: it says so, and a signal ends it."""

import os
import random
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest
from child import environment
from cpu_time import computes_at_most
from live import Ros, wait_until

from stickslip_ros.base.numba_internals import is_whole

#: As the executable that is installed does.
COMMAND = [
    sys.executable,
    "-c",
    "import sys; from stickslip_ros.executables import axis_node; sys.exit(axis_node())",
]
SIGNALS = int(os.environ.get("STICKSLIP_SIGNALS", "4"))
ENDS_WITHIN = 2.0  # s of computing


def _catches_sigterm(pid: int) -> bool:
    """Whether the process has come as far as its own code; before, a signal ends any program."""
    status = Path(f"/proc/{pid}/status").read_text()
    caught = int(status.partition("SigCgt:")[2].split()[0], 16)
    return bool(caught >> (signal.SIGTERM - 1) & 1)


def _start(cache: Path, output: Path) -> subprocess.Popen[bytes]:
    given = environment(NUMBA_CACHE_DIR=str(cache))
    with output.open("wb") as stream:
        return subprocess.Popen(COMMAND, stdout=stream, stderr=stream, env=given)


@pytest.mark.long
def test_a_signal_at_any_moment_ends_a_first_start(ros_domain: int, tmp_path: Path) -> None:
    """With 2 s of work, exit code 0, no traceback; what was compiled until then is whole.

    STICKSLIP_SIGNALS=30 tries thirty moments.
    """
    rng = random.Random(7)
    for number in range(SIGNALS):
        output = tmp_path / f"{number}.log"
        child = _start(tmp_path / "cache", output)
        try:
            wait_until(partial(_catches_sigterm, child.pid), "Python itself")
            time.sleep(rng.uniform(0.0, 12.0))
            asked = time.monotonic()
            with computes_at_most(ENDS_WITHIN, child.pid):
                child.send_signal(rng.choice([signal.SIGINT, signal.SIGTERM]))
                code = child.wait(60.0)
            took = time.monotonic() - asked
        finally:
            child.kill()
            child.wait()
        said = output.read_text()
        assert code == 0, said
        assert "Traceback" not in said
        print(f"{number}: ended within {took:.2f} s: {said.splitlines()[-1:]}")
    files = [f for f in (tmp_path / "cache").rglob("*") if f.suffix in (".nbi", ".nbc")]
    assert files
    assert all(is_whole(str(file)) for file in files)


@pytest.mark.long
def test_a_first_start_says_so_and_shows_no_topic_before_it_is_ready(
    ros: Ros, tmp_path: Path
) -> None:
    user = ros.node("user")
    output = tmp_path / "log"
    child = _start(tmp_path / "cache", output)
    try:
        ros.wait_until(lambda: "compiling the solver" in output.read_text(), "the word")
        for _ in range(20):
            assert user.count_subscribers("/stickslip_axis/command/steps") == 0
            assert "stickslip_axis" not in user.get_node_names()
            time.sleep(0.1)
        assert child.poll() is None
        assert "ready" not in output.read_text()
    finally:
        child.terminate()
        assert child.wait(60.0) == 0
