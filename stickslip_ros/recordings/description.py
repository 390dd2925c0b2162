# SPDX-License-Identifier: Apache-2.0
"""What is in a bag, as one plain object."""

from __future__ import annotations

from typing import Any

from stickslip_ros.recordings.reader import BagReader
from stickslip_ros.recordings.runs import recorded_axes

_NS = 1e-9


def describe(bag: BagReader) -> dict[str, Any]:
    """Return what is in a bag, SI units; times since the Unix epoch in ns are whole numbers.

    :raises BagError: a start event is damaged.
    """
    return {
        "bag": str(bag.path),
        "size": sum(bag.sizes.values()),
        "start_ns": bag.start_ns,
        "end_ns": bag.end_ns,
        "duration": (bag.end_ns - bag.start_ns) * _NS,
        "messages": bag.message_count,
        "files": [
            {
                "name": file.name,
                "size": bag.sizes[file.name],
                "messages": file.message_count,
                "start_ns": file.start_ns,
                "end_ns": file.end_ns,
            }
            for file in bag.files
        ],
        "compression": bag.compressions,
        "packed": bag.metadata.compression_mode,
        "topics": [
            {
                "name": topic.name,
                "type": topic.type,
                "messages": bag.counts[topic.name],
                "type_hash": topic.type_hash,
                "encoding": topic.encoding,
                "offered_qos": [profile.as_dict() for profile in topic.offered_qos],
            }
            for topic in bag.topics.values()
        ],
        "ros_distro": bag.metadata.ros_distro,
        "metadata_version": bag.metadata.version,
        "written_by": bag.libraries,
        "custom_data": bag.custom_data,
        "warnings": bag.warnings,
        "axes": recorded_axes(bag),
    }
