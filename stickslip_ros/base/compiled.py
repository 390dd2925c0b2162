# SPDX-License-Identifier: Apache-2.0
"""Compiles functions of numbers and flat arrays, and caches them on disk.

numba watches only the file of the function that is called from Python. The kernel calls functions
of other files, so the cache folder carries a digest of every source that may hold compiled code and
of the tables of numbers beside them: an edit anywhere in them compiles the kernel anew, and never
runs code compiled from older text.

The cache holds machine code, so a folder that other users can write to is not used; where no place
is safe, each process compiles for itself and says so.

numba's own way takes more than twice the time; `numba_internals.py` is the quicker one, for the
versions of numba that it knows.
"""

from __future__ import annotations

import contextlib
import hashlib
import inspect
import marshal
import os
import stat
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

try:
    import numba
    from numba.core.event import Listener, install_listener

    from stickslip_ros.base import numba_internals
except ImportError:  # all of it runs as plain Python too, a hundred times slower
    numba = install_listener = None
    Listener = object

_PACKAGE = Path(__file__).parents[1]
_ROOMS = ("physics/laws", "physics/model", "physics/solver")
#: Code, and the tables whose numbers are compiled into it
_SOURCES = (".py", ".csv")

#: Sources of functions that are not of this package, which the kernel is compiled with
_foreign: list[bytes] = []

F = TypeVar("F", bound=Callable[..., Any])


def cache_folder() -> str:
    """Return the cache folder for the present sources, "" if no place is safe."""
    return str(next(filter(_is_safe, _cache_places()), ""))


def _cache_places() -> list[Path]:
    """Return where the cache may be, the best place first."""
    digest = hashlib.sha256()
    for room in _ROOMS:
        for source in sorted((_PACKAGE / room).rglob("*.*")):
            if source.suffix in _SOURCES:
                digest.update(source.read_bytes())
    for part in _foreign:
        digest.update(part)
    name = f"kernel-{digest.hexdigest()[:16]}"
    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    places = [Path(home) / "stickslip_ros" / name]
    if chosen:
        places.insert(0, Path(chosen) / name)
    elif os.access(_PACKAGE, os.W_OK):
        places.insert(0, _PACKAGE / "__pycache__" / name)
    return places


def _unsafe_cache() -> str:
    """Return a sentence where the best place is not safe; "" where it is."""
    best, folder = _cache_places()[0], cache_folder()
    if str(best) == folder:
        return ""
    used = f"{folder} is used" if folder else "every process compiles for itself"
    open_place = _open_to_others(best)
    return f"others can write to {open_place}, so {used}: chmod go-w, or set NUMBA_CACHE_DIR"


def _is_safe(folder: Path) -> bool:
    """Return whether only this user and root can put files into a folder or replace it."""
    return _open_to_others(folder) is None


def _open_to_others(folder: Path) -> Path | None:
    """Return the folder through which others can put files into one; None if they cannot.

    Where a link leads is looked at as its name is: both can be replaced.
    """
    if not hasattr(os, "getuid"):
        return None
    real = Path(os.path.realpath(folder))
    for place in dict.fromkeys((folder, *folder.parents, real, *real.parents)):
        try:
            found = place.stat()
        except OSError:  # it is not there yet, and this user will make it
            continue
        # With the sticky bit, as in /tmp, others may add files but not replace those of this user.
        others = found.st_mode & stat.S_IWOTH or (
            found.st_mode & stat.S_IWGRP and _has_others(found.st_gid)
        )
        if others and (place in (folder, real) or not found.st_mode & stat.S_ISVTX):
            return place
        if found.st_uid not in (os.getuid(), 0):
            return place
    return None


def _has_others(group: int) -> bool:
    """Return whether a group has members beside this user and root, or may have."""
    import grp  # not on Windows
    import pwd

    try:
        mine = {pwd.getpwuid(user).pw_name for user in (os.getuid(), 0)}
        members = {*grp.getgrgid(group).gr_mem}
    except KeyError:  # of users that this machine does not know by name, so of anybody
        return True
    first = {one.pw_name for one in pwd.getpwall() if one.pw_gid == group}
    return bool((members | first) - mine)


_FOLDER = cache_folder()


def compile_beside(function: Callable[..., Any]) -> None:
    """Keep what is compiled from now on apart, as it calls a function that is not of this package.

    An edit of its file, or in a notebook of its code, compiles the kernel anew.
    """
    global _FOLDER
    file = Path(inspect.getsourcefile(function) or "")
    _foreign.append(file.read_bytes() if file.is_file() else marshal.dumps(function.__code__))
    _FOLDER = cache_folder()


def records_in(buffer: Any, kind: Any) -> Any:
    """Return the records of a dtype in a flat array of float64, without a copy.

    As ``buffer.view(kind)``, for which numba compiles texts of errors for 3 s.
    """
    return buffer.view(kind)


if numba:

    @numba.extending.intrinsic
    def _address(typing: Any, array: Any) -> Any:
        def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            data = context.make_array(signature.args[0])(context, builder, values[0]).data
            return builder.bitcast(data, context.get_value_type(numba.types.voidptr))

        return numba.types.voidptr(array), code

    @numba.extending.overload(records_in)
    def _records_in(buffer: Any, kind: Any) -> Any:
        numbers = kind.dtype.size // 8

        def records(buffer: Any, kind: Any) -> Any:
            return numba.carray(_address(buffer), (len(buffer) // numbers,), kind)

        return records


_RENEWED = 2.0  # s, between words on how far compiling is
_functions = 0  # registered so far, which is about what a first start compiles


#: What only code in C would call is left out: it takes a fifth of the time.
_OPTIONS = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}


def compiled_anew(function: F) -> F:
    """Compile ``function`` like `compiled`, but in every process: a closure cannot be cached.

    Compiled functions that call it are cached, including its code.
    """
    if not numba:
        return function
    return numba_internals.in_parts(numba.njit(**_OPTIONS)(function), _OPTIONS)


def compiled_inline(function: F) -> F:
    """Inline ``function`` into its callers, because a call would cost as much as its work."""
    if not numba:
        return function
    options = {"forceinline": True, **_OPTIONS}
    return numba_internals.in_parts(numba.njit(**options)(function), options)


def compiled(function: F) -> F:
    """Compile ``function`` on its first call and cache the result on disk.

    The interpreter lock is released while it runs. Division by zero gives inf or nan as in numpy.
    Without numba, and with NUMBA_DISABLE_JIT=1, the function stays plain Python.
    """
    if not numba:
        return function
    global _functions
    _functions += 1
    if not _FOLDER:
        return compiled_anew(function)
    if numba.config.DISABLE_JIT:
        return function
    before = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = _FOLDER
    try:
        return numba_internals.compile_cached(function, _OPTIONS)
    except RuntimeError:  # no folder that can be written: it is compiled in every process
        return compiled_anew(function)
    finally:
        numba.config.CACHE_DIR = before


@contextlib.contextmanager
def report_compilation() -> Iterator[None]:
    """Report on stderr if the kernel compiles in this block, and how far it is."""
    if not numba:
        sys.stderr.write(
            "without numba the solver is slow (100 Hz in real time): pip install numba\n"
        )
        yield
        return
    reporter = _Reporter()
    with install_listener("numba:compile", reporter):
        try:
            yield
        finally:
            reporter.end()


class _Reporter(Listener):
    """Says on stderr how far compiling is, in one line; loading from the cache is not reported."""

    def __init__(self) -> None:
        self._done: set[str] = set()  # functions of this package; numba compiles some of its own
        self._said = 0.0  # s, when

    def on_start(self, event: Any) -> None:
        self._say()

    def on_end(self, event: Any) -> None:
        function = event.data["dispatcher"].py_func
        if function.__module__.startswith(f"{_PACKAGE.name}."):
            self._done.add(f"{function.__module__}.{function.__qualname__}")
        self._say()

    def _say(self) -> None:
        """Print the line, and on a terminal renew it from time to time."""
        renewed = sys.stderr.isatty()
        if not self._said or (renewed and time.monotonic() - self._said > _RENEWED):
            if not self._said and (unsafe := _unsafe_cache()):
                print(unsafe, file=sys.stderr)
            self._said = time.monotonic()
            share = min(99, 100 * len(self._done) // max(_functions, 1))
            text = f"compiling the solver, once for this version: {share} %"
            print(text, end="\r" if renewed else "\n", file=sys.stderr, flush=True)

    def end(self) -> None:
        """End the line of a terminal."""
        if self._said and sys.stderr.isatty():
            print(file=sys.stderr, flush=True)
