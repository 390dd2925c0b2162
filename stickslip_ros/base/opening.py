# SPDX-License-Identifier: Apache-2.0
"""Opens every file that is read: regular files only, with a bounded unpacked size.

Reading a pipe or a device could wait for ever; a packed file of a few kilobytes may unpack to more
than the memory. Every reader opens with :func:`open_regular` and counts unpacked bytes with an
:class:`Allowance`.
"""

from __future__ import annotations

import errno
import math
import os
import stat
from pathlib import Path
from typing import BinaryIO

from stickslip_ros.base.errors import StickslipError

#: Largest ratio of unpacked to packed size. Measurements and recordings shrink by 2 to 50, zeros
#: with lz4 by 255; files made to fill a machine, by 1000 to 10000.
UNPACK_FACTOR = 300
#: Environment variable with a larger factor, for a file that deserves it
UNPACK_VARIABLE = "STICKSLIP_UNPACK_FACTOR"
#: Bytes that every file may unpack to, however small it is: they harm no machine
ALWAYS_ALLOWED = 64 * 1024 * 1024


class ReadError(StickslipError):
    """A file cannot be read, or not safely; the text names it, the limit and the cure."""


def open_regular(path: Path | str, largest: int | None = None) -> BinaryIO:
    """Open a regular file for reading bytes; links are followed.

    Parameters
    ----------
    path
        The file.
    largest
        Bytes that it may have; None for no limit.

    Returns
    -------
    BinaryIO
        The open file, at its beginning.

    Raises
    ------
    ReadError
        It is a folder, a pipe, a device or a socket, or it is too large.
    OSError
        The operating system does not let us read it.
    """
    # Without O_NONBLOCK, opening a pipe waits for a writer.
    handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    try:
        found = os.fstat(handle)
        if stat.S_ISDIR(found.st_mode):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
        if not stat.S_ISREG(found.st_mode):
            raise ReadError(f"{path} is not a file but a pipe or a device; copy it to a file first")
        if largest is not None and found.st_size > largest:
            raise ReadError(f"{path} has {found.st_size} bytes; at most {largest} are read")
        return os.fdopen(handle, "rb")
    except BaseException:
        os.close(handle)
        raise


class Allowance:
    """How many bytes a file may still unpack to: a multiple of its size.

    The multiple is :data:`UNPACK_FACTOR`; a larger one in the environment variable
    :data:`UNPACK_VARIABLE` takes its place. :data:`ALWAYS_ALLOWED` bytes are free.

    Attributes
    ----------
    left : int
        Bytes that may still come.
    """

    def __init__(self, path: Path | str, size: int | None = None) -> None:
        """Begin with nothing unpacked.

        Parameters
        ----------
        path
            The file, named in the error.
        size
            Its size on the disk (bytes); None to look.

        Raises
        ------
        OSError
            Its size cannot be found out.
        ReadError
            The environment variable holds no number.
        """
        self._path = path
        self._factor = _unpack_factor()
        size = os.stat(path).st_size if size is None else size
        self.left = max(ALWAYS_ALLOWED, math.floor(size * self._factor))

    def spend(self, count: int) -> None:
        """Take note of bytes that were, or are about to be, unpacked.

        Parameters
        ----------
        count
            How many they are.

        Raises
        ------
        ReadError
            The file has unpacked to more than it may.
        """
        self.left -= count
        if self.left < 0:
            raise ReadError(
                f"{self._path} unpacks to more than {self._factor:g} times its size; if you trust "
                f"it, set {UNPACK_VARIABLE} to a larger number in the environment"
            )


def _unpack_factor() -> float:
    text = os.environ.get(UNPACK_VARIABLE, "")
    try:
        return max(UNPACK_FACTOR, min(float(text), 1e9)) if text else UNPACK_FACTOR
    except ValueError:
        raise ReadError(
            f"{UNPACK_VARIABLE} is {text!r}; it has to be a number, 1000, say"
        ) from None
