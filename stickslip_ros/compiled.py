# SPDX-License-Identifier: Apache-2.0
"""How functions of numbers and flat arrays are compiled, and where the result is kept.

numba watches only the file of the function that is called from Python. The kernel calls functions
of other files, so the cache folder carries a digest of every source that may hold compiled code: an
edit anywhere in them compiles afresh, and never runs what was compiled from older text.

What is loaded is machine code. So each file of the cache ends with a checksum, and one that does
not fit is compiled again; and a folder that other users can write to is not used.

numba optimises every function together with all that it calls and makes machine code of them, and
then does so again for each of its callers. Of a kernel of a hundred small functions, half of the
time goes there. So a function that another compiled one calls is handed to it as `_Part`, typed
and lowered only; LLVM sees the whole once, from the function that Python calls.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import os
import stat
import sys
import time
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from stickslip_ros.plain_first import SAY_EVERY, plain_first, prefer_plain

try:
    import numba
    from numba.core.caching import FunctionCache, IndexDataCacheFile
    from numba.core.event import Listener, install_listener
    from numba.core.runtime import rtsys
except ImportError:  # all of it runs as plain Python too, a hundred times slower
    numba = install_listener = None
    FunctionCache = IndexDataCacheFile = Listener = object
try:
    from numba.core import compiler
    from numba.core.codegen import JITCodeLibrary
    from numba.core.dispatcher import _FunctionCompiler  # type: ignore[attr-defined]
    from numba.core.registry import CPUDispatcher
except ImportError:  # no numba, or one that is built otherwise: it takes twice as long to compile
    compiler = None
    JITCodeLibrary = _FunctionCompiler = CPUDispatcher = object

_PACKAGE = Path(__file__).parent
_ROOMS = ("laws", "model", "solver")

F = TypeVar("F", bound=Callable[..., Any])


def _cache_folder() -> str:
    digest = hashlib.sha256()
    for room in _ROOMS:
        for source in sorted((_PACKAGE / room).rglob("*.py")):
            digest.update(source.read_bytes())
    name = f"kernel-{digest.hexdigest()[:16]}"
    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    places = [Path(home) / "stickslip_ros" / name]
    if chosen:
        places.insert(0, Path(chosen) / name)
    elif os.access(_PACKAGE, os.W_OK):
        places.insert(0, _PACKAGE / "__pycache__" / name)
    return str(next(filter(_is_safe, places), ""))


def _is_safe(folder: Path) -> bool:
    """Return whether nobody but this user and root can put files into a folder or replace it."""
    if not hasattr(os, "getuid"):
        return True
    for place in (folder, *folder.parents):
        try:
            found = place.stat()
        except OSError:  # it is not there yet, and this user will make it
            continue
        # With the sticky bit, as in /tmp, others may add files but not replace those of this user.
        others = found.st_mode & stat.S_IWOTH
        if others and (place == folder or not found.st_mode & stat.S_ISVTX):
            return False
        if found.st_uid not in (os.getuid(), 0):
            return False
    return True


_FOLDER = _cache_folder()
_functions = 0  # registered so far, which is about what a first start compiles


#: What only code in C would call is left out: it takes a fifth of the time.
_OPTIONS = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}


def compiled_anew(function: F) -> F:
    """Compile ``function`` as `compiled` does, in every process: a closure cannot be kept on disk.

    What calls it from another compiled function is kept, and holds it.
    """
    return _with_part(numba.njit(**_OPTIONS)(function)) if numba else function


def compiled_inline(function: F) -> F:
    """Compile ``function`` into what calls it, where a call would cost as much as its work."""
    if not numba:
        return function
    return _with_part(numba.njit(forceinline=True, **_OPTIONS)(function), True)  # type: ignore[no-any-return]


def compiled(function: F) -> F:
    """Compile ``function`` on its first call and keep the result on disk.

    The interpreter lock is released while it runs. Division by zero gives inf or nan as in numpy.
    Without numba, and with NUMBA_DISABLE_JIT=1, the function stays plain Python.
    """
    if not numba:
        return function
    global _functions
    _functions += 1
    if not _FOLDER:
        return compiled_anew(function)
    dispatcher = numba.njit(**_OPTIONS)(function)
    if not hasattr(dispatcher, "_cache"):  # NUMBA_DISABLE_JIT
        return function
    before = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = _FOLDER
    try:
        dispatcher._cache = _Cache(function)
        prefer_plain(dispatcher)
    except RuntimeError:  # no folder that can be written: it is compiled in every process
        pass
    finally:
        numba.config.CACHE_DIR = before
    return _with_part(dispatcher)  # type: ignore[no-any-return]


def _with_part(dispatcher: Any, inline: bool = False) -> Any:
    """Let compiled functions that call this one take the part of it."""
    if compiler is not None and isinstance(dispatcher, CPUDispatcher):
        options = {"nopython": True, "no_cpython_wrapper": True, "forceinline": inline, **_OPTIONS}
        # Made when it is needed: to load compiled functions none is.
        part = cache(lambda: _Part(dispatcher.py_func, options))
        dispatcher.part = part
        dispatcher.get_call_template = lambda *call: part().get_call_template(*call)
        dispatcher.get_overload = lambda signature: part().get_overload(signature)
    return dispatcher


class _Part(CPUDispatcher):
    """A function for other compiled functions to call: nothing of it can be called from Python."""

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        super().__init__(function, targetoptions=options)
        own: Any = self._compiler
        self._compiler: Any = _PartCompiler(
            function, own.targetdescr, options, own.locals, own.pipeline_class
        )

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Find or make what serves a call; constants among its arguments are like any number."""
        kws = {name: numba.types.unliteral(kind) for name, kind in kws.items()}
        return super().get_call_template(tuple(map(numba.types.unliteral, args)), kws)

    def add_overload(self, result: Any) -> None:
        result = result._replace(entry_point=object())  # there is none, but it serves as a key
        self.targetctx.insert_user_function(result.entry_point, result.fndesc, [result.library])
        self.overloads[tuple(result.signature.args)] = result


class _PartCompiler(_FunctionCompiler):
    """Types and lowers a function, and leaves the rest to the function that calls it."""

    def _compile_core(self, args: Any, return_type: Any) -> Any:
        flags = compiler.Flags()
        self.targetdescr.options.parse_as_flags(flags, self.targetoptions)
        flags.no_compile = True
        target = self.targetdescr.target_context
        return compiler.compile_extra(
            self.targetdescr.typing_context,
            target,
            self.py_func,
            args=args,
            return_type=return_type,
            flags=flags,
            locals=self.locals,
            library=_PartLibrary(target.codegen(), self.py_func.__qualname__),
            pipeline_class=self.pipeline_class,
        )


class _PartLibrary(JITCodeLibrary):
    """The code of a part and of all that it calls."""

    def finalize(self) -> None:
        """Link what is called, and neither optimise it nor make machine code of it."""
        for library in dict.fromkeys(self._linking_libraries):
            self._reload_init.update(library._reload_init)
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._finalized = True


class _Cache(FunctionCache):
    """Keeps what is compiled of one function, and loads it without what compiling needs."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        plain = self._cache_file
        self._cache_file: Any = _CheckedFile(
            plain._cache_path, plain._index_name.removesuffix(".nbi"), plain._source_stamp
        )

    def load_overload(self, signature: Any, target: Any) -> Any:
        """Return the compiled function of a signature, or None.

        numba first imports everything that compiling may need, which takes 0.4 s. Machine code
        needs its runtime alone; to compile, numba does the rest then.
        """
        rtsys.initialize(target)
        with self._guard_against_spurious_io_errors():
            return self._load_overload(signature, target)


class _CheckedFile(IndexDataCacheFile):
    """The cache of one function; a file of it that was cut or changed counts as not there."""

    @contextlib.contextmanager
    def _open_for_write(self, filepath: str) -> Iterator[io.BytesIO]:
        content = io.BytesIO()
        yield content
        data = content.getvalue()
        with super()._open_for_write(filepath) as file:
            file.write(data + hashlib.sha256(data).digest())  # behind the end of the pickle

    def _load_index(self) -> dict[Any, str]:
        return super()._load_index() if _is_whole(self._index_path) else {}

    def _load_data(self, name: str) -> Any:
        path = self._data_path(name)
        if not _is_whole(path):
            raise OSError(f"{path} is damaged")
        return super()._load_data(name)

    def save(self, key: Any, data: Any) -> None:
        # A full disk costs the cache, not the run.
        with contextlib.suppress(OSError):
            super().save(key, data)


def _is_whole(path: str) -> bool:
    try:
        content = Path(path).read_bytes()
    except OSError:
        return False
    return hashlib.sha256(content[:-32]).digest() == content[-32:]


@contextlib.contextmanager
def first_result() -> Iterator[None]:
    """Do without compiling in this block as long as another process does it; see `plain_first`.

    For results that need not repeat to the last bit, and come from a few drive cycles.
    """
    with telling_when_compiling(), plain_first(_FOLDER):
        yield


@contextlib.contextmanager
def telling_when_compiling() -> Iterator[None]:
    """Report on stderr if the kernel compiles in this block, and how far it is."""
    if not numba:
        sys.stderr.write(
            "without numba the solver is slow (100 Hz in real time): pip install numba\n"
        )
        yield
        return
    with install_listener("numba:compile", _Teller()):
        yield


class _Teller(Listener):
    """Hears of each function that is compiled; loading one from the cache is not reported."""

    def __init__(self) -> None:
        self._done: set[str] = set()  # functions of this package; numba compiles some of its own
        self._said = 0.0

    def on_start(self, event: Any) -> None:
        self._say()

    def on_end(self, event: Any) -> None:
        function = event.data["dispatcher"].py_func
        if function.__module__.startswith(f"{__package__}."):
            self._done.add(f"{function.__module__}.{function.__qualname__}")
        self._say()

    def _say(self) -> None:
        now = time.monotonic()
        if now - self._said < SAY_EVERY and self._said:
            return
        self._said = now
        share = min(99, 100 * len(self._done) // max(_functions, 1))
        sys.stderr.write(f"compiling the solver, once for this version: {share} %\n")
        sys.stderr.flush()
