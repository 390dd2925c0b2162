# SPDX-License-Identifier: Apache-2.0
"""The folder of a bag: its ``metadata.yaml`` and its storage files."""

from __future__ import annotations

import re
from pathlib import Path

from stickslip_ros.opening import open_regular
from stickslip_ros.recordings.errors import BagError, unreadable
from stickslip_ros.recordings.metadata import METADATA_FILE, StoredMetadata, parse_metadata

# No more of a ``metadata.yaml`` needs to be read; what is longer is refused.
_METADATA_BYTES = 4 * 1024 * 1024
#: Ends of the names of storage files, by the word of ``metadata.yaml`` for their kind
_ENDS = {"mcap": (".mcap", ".mcap.zstd"), "sqlite3": (".db3",)}


def stored_metadata(path: Path) -> StoredMetadata | None:
    """Read the ``metadata.yaml`` of a bag, None if there is none.

    :raises BagError: it cannot be read or is broken.
    """
    file = path / METADATA_FILE
    if not path.is_dir() or not file.exists():
        return None
    try:
        with open_regular(file) as stream:
            return parse_metadata(stream.read(_METADATA_BYTES).decode())
    except OSError as error:
        raise unreadable(file, error) from error
    except ValueError as error:
        reason = " ".join(str(error).split())[:200]
        raise BagError(
            f"{file} is not what rosbag2 writes: {reason}; repair it, or move it away: "
            "the bag can be read without it"
        ) from error


def storage_files(path: Path, stored: StoredMetadata | None = None) -> list[Path]:
    """Return the storage files of a bag, all of one kind, in the order of their numbers.

    :param path: a folder, or one file.
    :param stored: what ``metadata.yaml`` says, which names the kind.
    :raises BagError: there is none.
    """
    if not path.exists():
        raise BagError(f"there is no bag {path}; check the name")
    if not path.is_dir():
        return [path]
    try:
        files = sorted(path.iterdir(), key=_natural)
    except OSError as error:
        raise unreadable(path, error) from error
    by_kind = {
        kind: [file for file in files if file.name.endswith(ends)] for kind, ends in _ENDS.items()
    }
    kind = (stored and stored.storage) or ("mcap" if by_kind["mcap"] else "sqlite3")
    if by_kind.get(kind):
        return by_kind[kind]
    if stored and stored.storage != "mcap":
        raise BagError(
            f"{path} is stored as {stored.storage}, of which it has no file that can be read; make "
            f"an MCAP bag of it with `ros2 bag convert -i {path} -o OPTIONS.yaml`, where "
            "OPTIONS.yaml says output_bags: [{uri: NEW, storage_id: mcap, all_topics: true}]"
        )
    raise BagError(f"there is no .mcap file in {path}; name the folder of a bag")


def _natural(path: Path) -> list[tuple[int, str]]:
    """Sort bag_2 before bag_10."""
    parts = re.split(r"(\d+)", path.name)
    return [(int(part[:300]), "") if part.isdecimal() else (-1, part) for part in parts]
