# SPDX-License-Identifier: Apache-2.0
"""Unpacking of what others packed: never more memory or disk than a limit says."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import IO

import lz4.frame
import zstandard

from stickslip_ros.recordings.errors import BagError, damaged

# A frame may ask its reader to keep that much of the past; rosbag2 asks for 8 MiB at most.
_LARGEST_WINDOW = 64 * 1024 * 1024
_LARGEST_MESSAGE = 64 * 1024 * 1024
# Bytes given to zstd at a time; what comes of it, 32 MB at most, is in memory at once.
_PIECE = 1024

# A whole file is unpacked to a temporary one. Recordings shrink by a factor of 2 to 50; zeros, or
# a file made to fill the disk, by 10000 and more.
_LARGEST_FACTOR = 1000


class UnpackError(ValueError):
    """Packed data is not what it says it is."""


def unpack(data: bytes | memoryview, compression: str, size: int) -> bytes:
    """Return unpacked data.

    :param compression: "", "lz4" or "zstd".
    :param size: what the result has to measure, bytes; never more than that is unpacked.
    :raises UnpackError: wrong size, broken data or an unknown compression.
    """
    unpacked = unpack_beginning(data, compression, size)
    if len(unpacked) != size:
        raise UnpackError(f"it unpacks to {len(unpacked)} bytes where it says {size}")
    return unpacked


def unpack_beginning(data: bytes | memoryview, compression: str, limit: int) -> bytes:
    """Return what can be unpacked of data that may end too early, limit + 1 bytes at most.

    :raises UnpackError: broken data or an unknown compression.
    """
    try:
        if compression == "":
            return bytes(data[: limit + 1])
        if compression == "zstd":
            return _unpack_zstd(data, limit + 1)
        if compression == "lz4":
            return lz4.frame.LZ4FrameDecompressor().decompress(bytes(data), max_length=limit + 1)
    except (zstandard.ZstdError, RuntimeError, EOFError, MemoryError) as error:
        raise UnpackError(f"its {compression} data is broken ({error})") from error
    raise UnpackError(f"compression {compression!r} is not known, only none, lz4 and zstd")


def unpack_message(data: bytes) -> bytes:
    """Return a message that rosbag2 packed with zstd by itself.

    :raises UnpackError: broken data, or a message larger than makes sense.
    """
    unpacked = unpack_beginning(data, "zstd", _LARGEST_MESSAGE)
    if len(unpacked) > _LARGEST_MESSAGE:
        raise UnpackError(f"it unpacks to more than {_LARGEST_MESSAGE} bytes")
    return unpacked


def _unpack_zstd(data: bytes | memoryview, most: int) -> bytes:
    # As a stream: asked for it all, the library takes the memory that the frame says.
    reader = zstandard.ZstdDecompressor(max_window_size=_LARGEST_WINDOW).stream_reader(data)
    return bytes(reader.read(most))


def open_storage(path: Path) -> tuple[IO[bytes], bool]:
    """Return an open storage file, and whether all of it could be unpacked.

    A file packed with zstd as a whole is unpacked to a temporary one, gone when closed.

    :raises BagError: it is no file, or its zstd data is broken.
    :raises OSError: it cannot be read, or the temporary folder has no room.
    """
    if path.exists() and not path.is_file():  # a pipe, say, where reading would wait forever
        raise BagError(f"{path} is not a file; name the folder of a bag, or an .mcap file")
    if path.suffix != ".zstd":
        return path.open("rb"), True
    unpacked = tempfile.TemporaryFile()  # noqa: SIM115  the caller closes it
    try:
        with path.open("rb") as packed:
            whole = _unpack_to(unpacked, packed, path)
        unpacked.seek(0)
    except zstandard.ZstdError as error:
        unpacked.close()
        raise damaged(path, f"its zstd data is broken ({error})") from error
    except BaseException:
        unpacked.close()
        raise
    return unpacked, whole


def _unpack_to(unpacked: IO[bytes], packed: IO[bytes], path: Path) -> bool:
    """Unpack a file; return whether its data came to an end."""
    left = path.stat().st_size * _LARGEST_FACTOR
    unpack = zstandard.ZstdDecompressor(max_window_size=_LARGEST_WINDOW).decompressobj()
    while not unpack.eof and (piece := packed.read(_PIECE)):
        data = unpack.decompress(piece)
        left -= len(data)
        if left < 0:
            raise damaged(path, f"it unpacks to more than {_LARGEST_FACTOR} times its size")
        unpacked.write(data)
    return bool(unpack.eof)
