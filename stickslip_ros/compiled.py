# SPDX-License-Identifier: Apache-2.0
"""How functions of numbers and flat arrays are compiled, and where the result is kept.

numba watches only the file of the function that is called from Python. Ours calls functions of
other files, so the cache folder carries a digest of every source that may hold compiled code: an
edit anywhere in them compiles afresh, and never runs what was compiled from older text.
"""

from __future__ import annotations

import hashlib
import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import numba

_PACKAGE = Path(__file__).parent
_ROOMS = ("model", "solver")
#: Loading from the cache stays well below this; compiling takes many times longer.
_PATIENCE_S = 2.0

F = TypeVar("F", bound=Callable[..., Any])


def _cache_folder() -> str:
    digest = hashlib.sha256()
    for room in _ROOMS:
        for source in sorted((_PACKAGE / room).rglob("*.py")):
            digest.update(source.read_bytes())
    name = f"kernel-{digest.hexdigest()[:16]}"
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    if chosen:
        return str(Path(chosen) / name)
    if os.access(_PACKAGE, os.W_OK):
        return str(_PACKAGE / "__pycache__" / name)
    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    return str(Path(home) / "stickslip_ros" / name)


_FOLDER = _cache_folder()


def compiled(function: F) -> F:
    """Compile ``function`` on its first call and keep the result on disk.

    The interpreter lock is released while it runs. Division by zero gives inf or nan as in numpy.
    With NUMBA_DISABLE_JIT=1 the function stays plain Python.
    """
    before = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = _FOLDER
    try:
        return numba.njit(nogil=True, error_model="numpy", cache=True)(function)  # type: ignore[no-any-return]
    except RuntimeError:  # no folder that can be written: compile in every process
        return numba.njit(nogil=True, error_model="numpy")(function)  # type: ignore[no-any-return]
    finally:
        numba.config.CACHE_DIR = before


@contextmanager
def telling_when_compiling() -> Iterator[None]:
    """Say on stderr that the kernel compiles if the first call in this block takes that long."""
    timer = threading.Timer(_PATIENCE_S, _say)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def _say() -> None:
    sys.stderr.write("compiling the solver, once for this version (about half a minute) ...\n")
    sys.stderr.flush()
