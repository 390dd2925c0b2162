# SPDX-License-Identifier: Apache-2.0
"""Runs the solver as plain Python while a background process compiles it.

Within `run_plain_meanwhile`, a function that is not in the cache yet runs as plain Python.
Meanwhile a background process compiles everything into the cache, and each call checks whether its
function is compiled by now. All other calls wait for that process (Ctrl-C ends the wait at once),
and compile functions that it leaves out. So results that have to repeat to the last bit (axes,
nodes, recordings, resimulation) never come from plain Python. Traces wait, too, because plain
Python would take longer.

The background process writes its progress into a file, its note, and locks it while it runs. So no
second one is started, and nobody waits for a killed one.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import CellType, FunctionType
from typing import IO, Any

if sys.platform != "win32":
    import fcntl

#: Set to "wait" to compile in the process itself, as tests and CI do. The background process has
#: another value.
CHOICE, _NOTED = "STICKSLIP_COMPILE", "wait and note"
#: What the background process runs: the user's own command that compiles everything.
COMMAND = (sys.executable, "-m", __package__, "warm-up")
_ROOT = Path(__file__).parent.parent
_LOOK = 0.05  # s, between looks for what is waited for
REPORT_EVERY = 2.0  # s, between words on how far it is

_asked = threading.local()
_child: subprocess.Popen[bytes] | None = None
_announced = False
_plain_functions: dict[Any, Any] = {}
_plain_globals: dict[str, dict[str, Any]] = {}


@contextlib.contextmanager
def run_plain_meanwhile() -> Iterator[None]:
    """Run functions that this thread calls in the block as plain Python until they are compiled."""
    outer = getattr(_asked, "plain", False)
    _asked.plain = True
    try:
        yield
    finally:
        _asked.plain = outer


def compile_in_background(dispatcher: Any) -> None:
    """Make a cached function of numba obey `run_plain_meanwhile`."""
    compile_it = dispatcher._compile_for_args
    index = Path(dispatcher._cache._cache_file._index_path)
    note = index.parents[1] / "compiling"
    own = dispatcher.py_func.__module__.startswith(f"{__package__}.")

    def chosen(*args: Any) -> Any:
        if not index.exists() and not os.environ.get(CHOICE, "").startswith("wait"):
            plain = getattr(_asked, "plain", False)
            if (plain or own) and _is_compiling(note) and plain:
                _announce()
                return _without_warnings(as_plain_python(dispatcher))
            _wait_for(index, note)
        return compile_it(*args)

    dispatcher._compile_for_args = chosen


def _without_warnings(function: Any) -> Callable[..., Any]:
    """Let divisions by zero pass without a word, as in compiled code."""
    import numpy as np

    def call(*args: Any) -> Any:
        with np.errstate(all="ignore"):
            return function(*args)

    return call


def as_plain_python(function: Any) -> Any:
    """Return a function as plain Python that calls plain Python; anything else as it is."""
    source = getattr(function, "py_func", None)
    if source is None:
        return function
    if source not in _plain_functions:
        name = source.__module__
        if name not in _plain_globals:
            _plain_globals[name] = dict(source.__globals__)
            for key, value in source.__globals__.items():
                _plain_globals[name][key] = as_plain_python(value)
        cells = tuple(
            CellType(as_plain_python(cell.cell_contents)) for cell in source.__closure__ or ()
        )
        _plain_functions[source] = FunctionType(
            source.__code__, _plain_globals[name], source.__name__, source.__defaults__, cells
        )
    return _plain_functions[source]


def _is_compiling(note: Path) -> bool:
    """Start the background process unless one has run; return whether one runs."""
    global _child
    if _child is not None:
        return _child.poll() is None
    paths = os.pathsep.join(filter(None, (str(_ROOT), os.environ.get("PYTHONPATH"))))
    try:
        note.parent.mkdir(parents=True, exist_ok=True)
        with note.open("ab") as file:
            if _lock(file):
                file.truncate(0)
                _child = subprocess.Popen(
                    COMMAND,
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.DEVNULL,
                    stderr=file,  # how far it is; and with this file it holds the lock
                    cwd=note.anchor,
                    start_new_session=True,  # Ctrl-C is for the program that asked
                    env={**os.environ, "PYTHONPATH": paths, CHOICE: _NOTED},
                )
    except OSError:  # nothing can be written, or started
        return False
    return True


def _wait_for(index: Path, note: Path) -> None:
    """Wait until the background process has compiled a function, or has ended."""
    while not index.exists() and (_child.poll() is None if _child else _is_held(note)):
        _waiting.say(lambda: _share(note))
        time.sleep(_LOOK)
    _waiting.end()


def _announce() -> None:
    """Print once that plain Python is used meanwhile."""
    global _announced
    if not _announced:
        _announced = True
        _say(
            "the solver runs as plain Python until it is compiled: that goes on in the "
            "background, once for this version, and takes about twenty seconds"
        )


def _say(text: str, end: str = "\n") -> None:
    sys.stderr.write(f"{text}{end}")
    sys.stderr.flush()


class ShareLine:
    """Says on stderr how far a work is: in one line, which is renewed on a terminal.

    In the background process each goes to the note in a line of its own.
    """

    def __init__(self, what: str) -> None:
        self._what = what
        self._said, self._open = 0.0, False

    def say(self, share: Callable[[], str]) -> None:
        """Say it with a share, such as " 35 %", if it is time to say it."""
        renewed, noted = sys.stderr.isatty(), os.environ.get(CHOICE) == _NOTED
        again = (renewed or noted) and time.monotonic() - self._said > REPORT_EVERY
        if not self._said or again:
            self._said, self._open = time.monotonic(), renewed
            _say(f"{self._what}{share()}", "\r" if renewed else "\n")

    def end(self) -> None:
        """End the line of a terminal."""
        if self._open:
            self._open = False
            _say("")


_waiting = ShareLine("waiting for the solver to be compiled in the background")


def _lock(note: IO[bytes]) -> bool:
    """Lock an open file until all that have it from this process have closed it, or ended."""
    if sys.platform != "win32":
        try:
            fcntl.flock(note, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            return False
    return True  # on Windows two programs may both compile


def _is_held(path: Path) -> bool:
    """Return whether a process that compiles has a note."""
    try:
        with path.open("rb") as note:
            return not _lock(note)
    except OSError:
        return False


def _share(path: Path) -> str:
    """Return the progress in a note, such as ": 35 %", if there is any."""
    with contextlib.suppress(OSError):
        last = path.read_text(encoding="utf-8", errors="replace").rstrip().rpartition(": ")[2]
        return f": {last}" if last.endswith("%") else ""
    return ""
