# SPDX-License-Identifier: Apache-2.0
"""Recordings: rosbag2 folders written, read, recovered; the runs in them, resimulation; no ROS.

Each name is loaded when it is used.

MCAP files are written and their records parsed by ``mcap``; messages are decoded and encoded by
``mcap_ros2``. Finding records and unpacking chunks is our own, for safety: the readers of ``mcap``
1.6 and ``rosbags`` 0.11 unpack a chunk to any size that it states, lz4 without a limit, their limit
on records does not hold for chunks found by the index, and both give up at the first damage, where
a recovery goes on with the next whole chunk.
"""

from typing import TYPE_CHECKING

from stickslip_ros.base.lazy_names import lazy_names

_PLACES = {
    "errors": "BagError",
    "messages": "decoder_for encoder_for statuses",
    "metadata": "OfferedQos TopicDescription",
    "reader": "BagReader open_bag",
    "recovery": "bytes_of recover",
    "writer": "COMPRESSIONS BagWriter",
    "resimulation": "resimulate",
    "schemas": "STATUS_TYPE schema_text",
    "runs": "describe recorded_axes recorded_runs",
}

if TYPE_CHECKING:
    from stickslip_ros.recordings.errors import BagError
    from stickslip_ros.recordings.messages import decoder_for, encoder_for, statuses
    from stickslip_ros.recordings.metadata import OfferedQos, TopicDescription
    from stickslip_ros.recordings.reader import BagReader, open_bag
    from stickslip_ros.recordings.recovery import bytes_of, recover
    from stickslip_ros.recordings.resimulation import resimulate
    from stickslip_ros.recordings.runs import describe, recorded_axes, recorded_runs
    from stickslip_ros.recordings.schemas import STATUS_TYPE, schema_text
    from stickslip_ros.recordings.writer import COMPRESSIONS, BagWriter
else:
    __getattr__ = lazy_names(__name__, _PLACES)

__all__ = [
    "COMPRESSIONS",
    "STATUS_TYPE",
    "BagError",
    "BagReader",
    "BagWriter",
    "OfferedQos",
    "TopicDescription",
    "bytes_of",
    "decoder_for",
    "describe",
    "encoder_for",
    "open_bag",
    "recorded_axes",
    "recorded_runs",
    "recover",
    "resimulate",
    "schema_text",
    "statuses",
]
