# SPDX-License-Identifier: Apache-2.0
"""The folder of a bag: what its ``metadata.yaml`` says, and its storage files."""

from __future__ import annotations

import re
from pathlib import Path

from stickslip_ros.opening import open_regular
from stickslip_ros.recordings.errors import BagError, unreadable
from stickslip_ros.recordings.metadata import (
    METADATA_BYTES,
    METADATA_FILE,
    NEWEST_VERSION,
    StoredMetadata,
    metadata_file,
)


def stored_metadata(path: Path) -> StoredMetadata | None:
    """Return what the ``metadata.yaml`` of a bag says, None if it has none.

    :raises BagError: it is broken, or of a version or a compression that is not known.
    """
    if not path.is_dir():
        return None
    file = path / METADATA_FILE
    if not file.exists():
        return None
    try:
        with open_regular(file) as stream:
            stored = metadata_file(stream.read(METADATA_BYTES).decode())
    except OSError as error:
        raise unreadable(file, error) from error
    except ValueError as error:
        raise BagError(
            f"{file} is not what rosbag2 writes: {error}; repair it, or move it away: "
            "the bag can be read without it"
        ) from error
    if stored.version > NEWEST_VERSION:
        raise BagError(
            f"{file} has version {stored.version}; the newest known version is {NEWEST_VERSION}; "
            "install a newer stickslip_ros"
        )
    if stored.compression_mode and stored.compression_format != "zstd":
        raise BagError(
            f"{path} is compressed with '{stored.compression_format}', but only zstd is supported; "
            "unpack it with `ros2 bag convert`"
        )
    return stored


MCAP_ENDS = (".mcap", ".mcap.zstd")
"""Ends of the names of storage files that are read by our own reader."""


def files_in(folder: Path, ends: tuple[str, ...] = MCAP_ENDS) -> list[Path]:
    """Return the storage files in a folder, in the order of their numbers.

    :param ends: of their names.
    :raises BagError: there is none, or they are of another kind.
    """
    try:
        files = sorted(folder.iterdir(), key=_natural)
    except OSError as error:
        raise unreadable(folder, error) from error
    found = [file for file in files if file.name.endswith(ends)]
    if not found:
        if any(".db3" in file.suffixes for file in files):
            raise not_mcap(folder)
        raise BagError(f"there is no {ends[0]} file in {folder}; name the folder of a bag")
    return found


def _natural(path: Path) -> list[tuple[int, str]]:
    """Sort bag_2 before bag_10."""
    parts = re.split(r"(\d+)", path.name)
    return [(int(part[:300]), "") if part.isdecimal() else (-1, part) for part in parts]


def not_mcap(path: Path, storage: str = "sqlite3") -> BagError:
    """Return the error for a bag of another storage format."""
    return BagError(
        f"{path} is stored as {storage}, which is not mcap; make an MCAP bag of it with "
        f"`ros2 bag convert -i {path} -o OPTIONS.yaml`, where OPTIONS.yaml says "
        "output_bags: [{uri: NEW, storage_id: mcap, all_topics: true}]"
    )
