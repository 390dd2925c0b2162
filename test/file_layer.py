# SPDX-License-Identifier: Apache-2.0
"""Faults and power cuts by the book: what changes files goes through here, is written down, fails.

:class:`FileLayer` stands between the program and the operating system: Python's own raw files and
the calls of ``os``. It lets one call fail, the next one in the next run, as SQLite tests itself;
and from what it wrote down, :meth:`FileLayer.after_power_cut` makes the folder as a disk may hold
it when the power fails: the content up to the last fsync, the rest gone.
"""

from __future__ import annotations

import builtins
import errno
import io
import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

_OS_CALLS = ("fsync", "rename", "replace", "mkdir", "unlink", "rmdir")
_REAL_OPEN = io.open


class _RawFile(io.FileIO):
    layer: FileLayer
    full = False

    def write(self, data: Any) -> int:
        piece = bytes(data)
        if self.full:
            self.full = self.layer.broken
            raise self.layer.fault()
        if self.layer.due("write", str(self.name)):
            # As a full disk does: some of it is taken, the next time nothing.
            self.full = True
            piece = piece[: len(piece) // 2]
            if not piece:
                raise self.layer.fault()
        at = self.tell()
        count = super().write(piece) or 0
        self.layer.wrote(self.name, at, piece[:count])
        return count


class FileLayer:
    """Counts, fails and remembers what a program does to the files in a folder."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, folder: Path) -> None:
        """Watch a folder until the test ends."""
        self.folder = folder
        self.calls: list[str] = []  #: what was called so far, as ``write bag_0.mcap``
        self.fail_at = -1  #: number of the call that fails; it and those that follow if `broken`
        self.broken = False
        self.number = errno.ENOSPC
        self._content: dict[str, bytearray] = {}  # as the program sees it, by file number
        self._durable: dict[str, bytes] = {}
        self._real = {name: getattr(os, name) for name in _OS_CALLS}
        monkeypatch.setattr(io, "open", self._open)
        monkeypatch.setattr(builtins, "open", self._open)
        for name in _OS_CALLS:
            monkeypatch.setattr(os, name, self._call(name))

    def due(self, what: str, name: str) -> bool:
        """Note a call; return whether it is the one to fail."""
        if not Path(name).is_relative_to(self.folder):
            return False
        number = len(self.calls)
        self.calls.append(f"{what} {Path(name).name}")
        return number == self.fail_at or (self.broken and 0 <= self.fail_at <= number)

    def fault(self) -> OSError:
        """Return the error of a call that fails."""
        return OSError(self.number, os.strerror(self.number))

    def wrote(self, name: Any, at: int, piece: bytes) -> None:
        """Remember what was written."""
        content = self._content.setdefault(str(name), bytearray())
        content[at : at + len(piece)] = piece

    def after_power_cut(self, out: Path) -> None:
        """Make the folder as the disk holds it for sure: what was brought there, by its name now.

        Names last from their making on, as journaling file systems have it after a second or two;
        what was never brought to the disk is an empty file.
        """
        shutil.copytree(self.folder, out)
        for file in filter(Path.is_file, out.rglob("*")):
            key = str(self.folder / file.relative_to(out))
            file.write_bytes(self._durable.get(key, b""))

    def _open(self, file: Any, mode: str = "r", *args: Any, **options: Any) -> Any:
        name = _full(file)
        if not Path(name).is_relative_to(self.folder) or not set(mode) & set("wxa+"):
            return _REAL_OPEN(file, mode, *args, **options)
        if self.due("open", name):
            raise self.fault()
        raw = _RawFile(name, mode.replace("b", "").replace("t", ""))
        raw.layer = self
        if set(mode) & set("wx"):
            self._content[name] = bytearray()
        buffered = io.BufferedWriter(raw) if "+" not in mode else io.BufferedRandom(raw)
        if "b" in mode:
            return buffered
        options.pop("buffering", None)
        return io.TextIOWrapper(buffered, *args[1:], **options)

    def _call(self, what: str) -> Callable[..., Any]:
        def call(where: Any, *args: Any, **options: Any) -> Any:
            if options.get("dir_fd") is None and self.due(what, _full(where)):
                raise self.fault()
            self._remember(what, where, *args)
            return self._real[what](where, *args, **options)

        return call

    def _remember(self, what: str, where: Any, *args: Any) -> None:
        name = _full(where)
        if what == "fsync" and name in self._content:
            self._durable[name] = bytes(self._content[name])
        elif what in ("rename", "replace"):
            new = _full(args[0])
            _rename(self._content, name, new)
            _rename(self._durable, name, new)


def _rename(contents: dict[str, Any], old: str, new: str) -> None:
    for name in [each for each in contents if each == old or each.startswith(old + os.sep)]:
        contents[new + name[len(old) :]] = contents.pop(name)


def _full(where: Any) -> str:
    """Return the full name of a file given by a name or a number."""
    if isinstance(where, int):
        return os.readlink(f"/proc/self/fd/{where}")
    return str(Path(os.fspath(where)).absolute())


def each_fault(
    work: Callable[[FileLayer, Path], None], folder: Path, broken: bool = False
) -> Iterator[tuple[str, BaseException | None, Path]]:
    """Run some work as often as it makes calls, with another one failing each time.

    Yields the call that failed, the exception that came of it and the folder it was done in.

    broken: whether all calls after that one fail, too.
    """
    number = 0
    while True:
        place = folder / f"{number}{'b' if broken else ''}"
        place.mkdir()
        raised: BaseException | None = None
        with pytest.MonkeyPatch.context() as patch:
            layer = FileLayer(patch, place)
            layer.fail_at, layer.broken = number, broken
            try:
                work(layer, place)
            except Exception as error:
                raised = error
        if len(layer.calls) <= number:
            assert raised is None, f"failed without a fault: {raised}"
            return
        yield layer.calls[number], raised, place
        number += 1
