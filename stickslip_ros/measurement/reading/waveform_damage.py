# SPDX-License-Identifier: Apache-2.0
"""Sizes and sums that oscilloscopes' own files state: where they do not hold, a file is damaged.

RigolWFM reads what is at the places that the headers name, whatever the file has lost or gained
before. What the makers state is in the manuals that `RigolWFM` names; that it holds was seen on
files of each.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from stickslip_ros.measurement.reading.table import MeasurementError

#: What begins behind the sum, in files of newer scopes by Tektronix.
_META = b"tekmeta!"
#: Bytes before the samples of Rigol's DS1000 families.
_RIGOL_HEADS = (276, 272, 256)


def check(path: Path, head: bytes) -> None:
    """Raise MeasurementError if a file is not as large as it states, or adds up to another sum.

    head holds the first bytes of the file, up to where its waveforms begin.
    """
    try:
        if head[:2] in (b"AG", b"RG"):
            _check_blocks(path)
        elif head[3:7] == b"WFM#":
            _check_sum(path, "<" if head[:1] == b"\x0f" else ">")
        elif head[:4] == b"\xa5\xa5\0\0":
            _check_rigol(path.stat().st_size, head)
    except struct.error:
        raise MeasurementError("its waveform ends within a header: it is damaged") from None


def _damaged(expected: int, size: int) -> MeasurementError:
    return MeasurementError(
        f"its waveform takes {expected} bytes, but there are {size}: it is damaged"
    )


def _check_blocks(path: Path) -> None:
    """Keysight's and Rigol's ``.bin``: waveforms one after the other, each with its buffers."""
    size = path.stat().st_size
    with path.open("rb") as file:

        def number(place: int, form: str) -> int:
            file.seek(place)
            (found,) = struct.unpack(form, file.read(struct.calcsize(form)))
            return int(found)

        # Since version 3 sizes have 64 bits.
        file.seek(0)
        long = file.read(4) in (b"AG03", b"RG03")
        at = 16 if long else 12
        for _ in range(number(at - 4, "<I")):
            buffers, points = number(at + 8, "<I"), number(at + 12, "<I")
            at += number(at, "<I")
            for _ in range(buffers):
                width, length = number(at + 6, "<H"), number(at + 8, "<Q" if long else "<I")
                if width * points != length or at > size:
                    raise MeasurementError(
                        f"its waveform states {points} samples in {length} bytes: it is damaged"
                    )
                at += number(at, "<I") + length
    if at != size:
        raise _damaged(at, size)


def _check_sum(path: Path, order: str) -> None:
    """Tektronix's ``.wfm``: the sum of all bytes before it, then nothing or facts by name."""
    content = path.read_bytes()
    end = 15 + struct.unpack_from(f"{order}i", content, 11)[0]
    if not 8 < end <= len(content) or content[end : end + len(_META)] not in (b"", _META):
        raise _damaged(end, len(content))
    (stated,) = struct.unpack_from(f"{order}Q", content, end - 8)
    found = int(np.frombuffer(content, np.uint8, end - 8).sum(dtype=np.uint64))
    if stated not in (0, found):  # some programs leave it out
        raise MeasurementError(f"its bytes add up to {found}, not {stated}: it is damaged")


def _check_rigol(size: int, head: bytes) -> None:
    """Rigol's ``.wfm`` of DS1000C, D and E: a byte a sample, two where logic was recorded."""
    (points,) = struct.unpack_from("<I", head, 28)
    bytes_each = int(head[49] != 0) + int(head[73] != 0) + 2 * (head[120] & 1)
    expected = [start + bytes_each * points for start in _RIGOL_HEADS]
    if size not in expected:
        raise _damaged(expected[0], size)
