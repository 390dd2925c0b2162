# SPDX-License-Identifier: Apache-2.0
"""Unpacks chunks, messages and files of a bag, with a bound on their size."""

from __future__ import annotations

import contextlib
import tempfile
from pathlib import Path
from typing import IO

import lz4.frame
import zstandard

from stickslip_ros.opening import Allowance, open_regular
from stickslip_ros.recordings.errors import damaged

COMPRESSIONS = ("", "lz4", "zstd")
"""How chunks of a bag are packed, as their records name it."""

# A frame may ask its reader to keep that much of the past; rosbag2 asks for 8 MiB at most.
_LARGEST_WINDOW = 64 * 1024 * 1024
_LARGEST_MESSAGE = 64 * 1024 * 1024
_UNPACKED_PIECE = 1024 * 1024  # bytes unpacked at a time; the allowance is checked in between
# Bytes given to zstd at a time; what comes of it, 32 MB at most, is in memory at once.
_PACKED_PIECE = 1024


class UnpackError(ValueError):
    """Compressed data do not match their size or format."""


def unpack(
    data: bytes | memoryview, compression: str, limit: int, allowance: Allowance | None
) -> bytes:
    """Unpack data that may end too early; return limit + 1 bytes at most.

    :param compression: one of :data:`COMPRESSIONS`.
    :param allowance: of its file; None where the sum is known to be within it.
    :raises UnpackError: broken data.
    :raises ReadError: the file has unpacked to more than it may.
    """
    try:
        if compression == "zstd":
            return _unpack_zstd(data, limit + 1, allowance)
        if compression == "lz4":
            press = lz4.frame.LZ4FrameDecompressor()
            unpacked = bytes(press.decompress(bytes(data), max_length=limit + 1))
            if allowance:
                allowance.spend(len(unpacked))
            return unpacked
        return bytes(data[: limit + 1])
    except (zstandard.ZstdError, RuntimeError, EOFError, MemoryError) as error:
        raise UnpackError(f"its {compression} data is broken ({error})") from error


def unpack_message(data: bytes, allowance: Allowance) -> bytes:
    """Return a message that rosbag2 packed with zstd by itself.

    :raises UnpackError: broken data, or a message larger than makes sense.
    :raises ReadError: the file has unpacked to more than it may.
    """
    unpacked = unpack(data, "zstd", _LARGEST_MESSAGE, allowance)
    if len(unpacked) > _LARGEST_MESSAGE:
        raise UnpackError(f"it unpacks to more than {_LARGEST_MESSAGE} bytes")
    return unpacked


def _unpack_zstd(data: bytes | memoryview, most: int, allowance: Allowance | None) -> bytes:
    # As a stream: asked for it all, the library takes the memory that the frame says.
    reader = zstandard.ZstdDecompressor(max_window_size=_LARGEST_WINDOW).stream_reader(data)
    pieces = []
    while most and (piece := reader.read(min(most, _UNPACKED_PIECE))):
        if allowance:
            allowance.spend(len(piece))
        pieces.append(piece)
        most -= len(piece)
    return b"".join(pieces)


def open_storage(path: Path) -> tuple[IO[bytes], bool]:
    """Return an open storage file, and whether all of it could be unpacked.

    A file packed with zstd as a whole is unpacked to a temporary one, gone when closed.

    :raises BagError: its zstd data is broken.
    :raises ReadError: it is no file, or unpacks to more than it may.
    :raises OSError: it cannot be read, or the temporary folder has no room.
    """
    stream = open_regular(path)
    if path.suffix != ".zstd":
        return stream, True
    with contextlib.ExitStack() as closing, stream:
        unpacked = closing.enter_context(tempfile.TemporaryFile())
        allowance = Allowance(path)
        press = zstandard.ZstdDecompressor(max_window_size=_LARGEST_WINDOW).decompressobj()
        try:
            while not press.eof and (piece := stream.read(_PACKED_PIECE)):
                data = press.decompress(piece)
                allowance.spend(len(data))
                unpacked.write(data)
        except zstandard.ZstdError as error:
            raise damaged(path, f"its zstd data is broken ({error})") from error
        unpacked.seek(0)
        closing.pop_all()  # the caller closes it
    return unpacked, bool(press.eof)
