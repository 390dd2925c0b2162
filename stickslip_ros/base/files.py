# SPDX-License-Identifier: Apache-2.0
"""Writes files and folders completely or not at all, and raises one error if that fails.

A file is written under a temporary name beside its own, synchronised to the disk and then renamed.
So a reader, a crash or a power cut never finds half a file, and two programs that write the same
file do not mix their lines.
"""

from __future__ import annotations

import contextlib
import errno
import os
import secrets
import shutil
from collections.abc import Iterator
from pathlib import Path

from stickslip_ros.base.errors import OUT_OF_MEMORY, StickslipError

_NO_ROOM = "make room on the disk or choose a place on another one"
_NO_RIGHT = "choose a place that you may write to"
_CURES = {
    errno.ENOSPC: _NO_ROOM,
    errno.EDQUOT: _NO_ROOM,
    errno.EFBIG: _NO_ROOM,
    errno.EACCES: _NO_RIGHT,
    errno.EPERM: _NO_RIGHT,
    errno.EROFS: _NO_RIGHT,
    errno.ENOENT: "make its folder first or choose another one",
    errno.ENOTDIR: "make its folder first or choose another one",
    errno.EISDIR: "choose a name that no folder has",
    errno.EEXIST: "choose another name, or remove it if it is not needed",
    errno.ENOTEMPTY: "choose another name, or remove it if it is not needed",
    errno.ENAMETOOLONG: "choose a shorter name",
    errno.EMFILE: "close other files or raise the limit (ulimit -n)",
    errno.ENFILE: "close other files or raise the limit (ulimit -n)",
}


class WriteError(StickslipError):
    """A file or folder cannot be written; the text names it, the reason and the cure."""

    def __init__(self, path: Path | str, error: OSError | MemoryError) -> None:
        """Describe an error of the operating system for a path."""
        super().__init__(f"cannot write {path}: {reason_and_cure(error)}")


def reason_and_cure(error: OSError | MemoryError) -> str:
    """Return the reason and the cure of an OSError while writing."""
    if isinstance(error, MemoryError):
        return OUT_OF_MEMORY
    cure = _CURES.get(error.errno or 0, "check the disk or choose another place")
    return f"{error.strerror or error}; {cure}"


@contextlib.contextmanager
def writing(path: Path | str) -> Iterator[None]:
    """Turn an OSError or MemoryError inside into a WriteError about a path."""
    try:
        yield
    except (OSError, MemoryError) as error:
        raise WriteError(path, error) from error


@contextlib.contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Give the temporary name to write to; at the end the file takes its real one.

    An exception leaves what was there before. A device or a pipe is written to directly.

    Raises WriteError: the file cannot be written; every OSError inside counts as that.
    """
    with writing(path):
        target = Path(os.path.realpath(path))  # the file a link points to, not the link
        if target.exists() and not target.is_file():
            if target.is_dir():
                raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
            yield path
            return
        part = _temporary(target)
        try:
            yield part
            synchronize(part)
            part.replace(target)
        finally:
            with contextlib.suppress(OSError):  # what went wrong before is what counts
                part.unlink(missing_ok=True)
        synchronize(target.parent)


def check_folder(path: Path) -> None:
    """Raise WriteError if the folder of a file is not there, before the work for it is done."""
    if not path.expanduser().absolute().parent.is_dir():
        raise WriteError(path, FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT)))


def write_text(path: Path, text: str) -> None:
    """Write a UTF-8 file, all of it or nothing; WriteError if that cannot be."""
    with whole_file(path) as part, part.open("w", encoding="utf-8", newline="") as file:
        file.write(text)


@contextlib.contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """Give the path of a folder to make; at the end it is moved to its real place.

    The folder given has its final name already, for files named after it, and is not there yet.
    An exception leaves nothing behind.

    Raises WriteError: it exists, its parent does not, or it cannot be written.
    """
    with writing(path):
        target = path.expanduser().absolute()
        if target.exists():
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST))
        around = _temporary(target)
        around.mkdir()
        made = around / target.name
        try:
            yield made
            made.rename(target)
            try:
                synchronize(target.parent)
            except OSError:
                target.rename(made)
                raise
        finally:
            shutil.rmtree(around, ignore_errors=True)


def synchronize(path: Path) -> None:
    """Bring a file, or the names in a folder, to the disk; OSError if that fails.

    Systems and file systems that cannot do that with a folder are taken as they are.
    """
    folder = path.is_dir()
    if folder and os.name == "nt":
        return
    handle = os.open(path, os.O_RDONLY if folder else os.O_RDWR)
    try:
        os.fsync(handle)
    except OSError as error:
        if not (folder and error.errno in (errno.EINVAL, errno.ENOTSUP)):
            raise
    finally:
        os.close(handle)


def _temporary(path: Path) -> Path:
    return path.with_name(f".{path.name}.{secrets.token_hex(4)}.part")
