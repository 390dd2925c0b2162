# SPDX-License-Identifier: Apache-2.0
"""Which reader a recording needs."""

from __future__ import annotations

from pathlib import Path

from stickslip_ros.recordings.mcap_records import reading
from stickslip_ros.recordings.other_bags import OtherBag
from stickslip_ros.recordings.reader import BagReader, stored_metadata

OTHER_SUFFIXES = (".db3", ".bag")
"""Ends of the names of recordings that are read through ``rosbags``."""


def open_bag(path: Path | str) -> BagReader:
    """Open a recording: a rosbag2 folder, one ``.mcap`` or ``.db3`` file, a ``.bag`` of ROS 1.

    :raises BagError: it cannot be read; the text names the file and the cure.
    """
    path = Path(path).expanduser().absolute()
    with reading(path):
        stored = stored_metadata(path)
        others = path.is_dir() and not stored and not any(path.glob("*.mcap*"))
        if (
            (stored and stored.storage == "sqlite3")
            or (path.suffix in OTHER_SUFFIXES and path.is_file())
            or (others and any(path.glob("*.db3")))
        ):
            return OtherBag(path, stored)
    return BagReader(path)
