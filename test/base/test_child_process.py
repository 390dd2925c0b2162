# SPDX-License-Identifier: Apache-2.0
"""A node in a child process that does not do its part."""

import subprocess
import sys
from pathlib import Path

import pytest

from stickslip_ros.base import child_process
from stickslip_ros.base.child_process import ChildError, ChildProcess


@pytest.mark.parametrize(
    ("program", "complaint"),
    [
        ("import time; time.sleep(60)", "node did not end: last words"),
        ("raise SystemExit(1)", "node failed: last words"),
    ],
)
def test_a_process_that_does_not_end_well(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, program: str, complaint: str
) -> None:
    monkeypatch.setattr(child_process, "_TIMEOUT", 1.0)
    log = tmp_path / "log"
    log.write_text("last words\n")
    with subprocess.Popen([sys.executable, "-c", program]) as child:
        with pytest.raises(ChildError, match=complaint):
            ChildProcess("node", log, child).ended()
        child.kill()
