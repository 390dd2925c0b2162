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

#: Set to "wait" to compile in the process itself, as tests and CI do.
CHOICE = "STICKSLIP_COMPILE"
_PACKAGE = Path(__file__).parent
_NOTE = "compiling"
#: Seconds after which a note is taken for left behind on Windows, where it cannot be locked so.
_LOST = 600.0
_LOOK = 0.05  # s, between looks for what is waited for
REPORT_EVERY = 2.0  # s, between words on how far it is
_COMPILE = (
    "import sys\n"
    "from stickslip_ros.library.compile_ahead import compile_all\n"
    "compile_all(sys.argv[1])\n"
)

_asked = threading.local()
_plain_functions: dict[Any, Any] = {}
_plain_globals: dict[str, dict[str, Any]] = {}


@contextlib.contextmanager
def run_plain_meanwhile(folder: str) -> Iterator[None]:
    """Run functions that this thread calls in the block as plain Python until they are compiled.

    folder is that of the cache; without one everything is compiled as it is called.
    """
    outer = getattr(_asked, "background", None)
    _asked.background = outer or (Background(folder) if folder else None)
    try:
        yield
    finally:
        _asked.background = outer


def compile_in_background(dispatcher: Any) -> None:
    """Make a cached function of numba obey `run_plain_meanwhile`."""
    compile_it = dispatcher._compile_for_args
    index = dispatcher._cache._cache_file._index_path
    folder = str(Path(index).parents[1])
    own = dispatcher.py_func.__module__.startswith(f"{__package__}.")

    def chosen(*args: Any, **options: Any) -> Any:
        background = getattr(_asked, "background", None)
        if not os.path.exists(index):
            if background is None:
                if own:
                    Background(folder).is_at_work()
                Background.wait_for(index)
            elif not options and background.is_at_work():
                background.announce()
                return _without_warnings(as_plain_python(dispatcher))
        return compile_it(*args, **options)

    dispatcher._compile_for_args = chosen


def _without_warnings(function: Callable[..., Any]) -> Callable[..., Any]:
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


class Background:
    """The background process that compiles; there is at most one on this machine."""

    _child: subprocess.Popen[bytes] | None = None
    _seen = False  # one of another process
    _announced = False

    def __init__(self, folder: str) -> None:
        self._note = Path(folder) / _NOTE

    def is_at_work(self) -> bool:
        """Start the process if none runs; return whether one runs."""
        kind = type(self)
        if os.environ.get(CHOICE, "") == "wait":
            return False
        if kind._child is not None:
            return kind._child.poll() is None
        if _is_held(self._note):
            kind._seen = True
            return True
        if kind._seen:  # one of another process has ended, and what is wanted is not there
            return False
        try:
            self._note.parent.mkdir(parents=True, exist_ok=True)
            with self._note.open("ab") as note:
                if _lock(note):
                    note.truncate(0)
                    kind._child = self._started(note)
        except OSError:  # nothing can be written, or started
            return False
        return True

    @classmethod
    def wait_for(cls, index: str) -> None:
        """Wait until the background process has compiled a function, or has ended."""
        if os.path.exists(index) or os.environ.get(CHOICE, "") == "wait":
            return
        note, said = Path(index).parents[1] / _NOTE, 0.0
        while not os.path.exists(index):
            if not (cls._child.poll() is None if cls._child else _is_held(note)):
                return
            if not said or time.monotonic() - said > REPORT_EVERY:
                said = time.monotonic()
                sys.stderr.write(
                    f"waiting for the solver to be compiled in the background{_share(note)}\n"
                )
                sys.stderr.flush()
            time.sleep(_LOOK)

    def _started(self, note: IO[bytes]) -> subprocess.Popen[bytes]:
        paths = os.pathsep.join(filter(None, (str(_PACKAGE.parent), os.environ.get("PYTHONPATH"))))
        return subprocess.Popen(
            [sys.executable, "-c", _COMPILE, str(self._note)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=note,  # how far it is; and with this file it holds the lock
            cwd=self._note.anchor,
            start_new_session=True,  # Ctrl-C is for the program that asked
            env={**os.environ, "PYTHONPATH": paths, CHOICE: "wait"},
        )

    def announce(self) -> None:
        """Print once that plain Python is used meanwhile."""
        if not type(self)._announced:
            type(self)._announced = True
            sys.stderr.write(
                "the solver runs as plain Python until it is compiled: that goes on in the "
                "background, once for this version, for half a minute\n"
            )
            sys.stderr.flush()


def _lock(note: IO[bytes]) -> bool:
    """Lock an open file until all that have it from this process have closed it, or ended."""
    if sys.platform == "win32":
        return True
    try:
        fcntl.flock(note, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def _is_held(path: Path) -> bool:
    """Return whether a process that compiles has a note."""
    try:
        with path.open("rb") as note:
            if sys.platform == "win32":
                return time.time() - os.fstat(note.fileno()).st_mtime < _LOST
            return not _lock(note)
    except OSError:
        return False


def _share(path: Path) -> str:
    """Return the progress in a note, such as ": 35 %", if there is any."""
    try:
        last = path.read_text(encoding="utf-8", errors="replace").rstrip().rpartition(": ")[2]
    except OSError:
        return ""
    return f": {last}" if last.endswith("%") else ""
