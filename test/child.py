# SPDX-License-Identifier: Apache-2.0
"""Programs that import this checkout, in processes of their own."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parent.parent
PATIENCE = 300.0  # s, for a process on a busy machine


def environment(**changes: str) -> dict[str, str]:
    """Return the environment of a child that imports this checkout and buffers as usual."""
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    path = os.pathsep.join(filter(None, (str(REPOSITORY), os.environ.get("PYTHONPATH"))))
    return {**kept, "PYTHONPATH": path, **changes}


def python(
    *arguments: str, cwd: Path | str | None = None, **changes: str
) -> subprocess.CompletedProcess[str]:
    """Run Python with arguments and changes of the environment; return what it said."""
    return subprocess.run(
        [sys.executable, *arguments],
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        cwd=cwd,
        env=environment(**changes),
    )
