# SPDX-License-Identifier: Apache-2.0
"""Recordings: rosbag2 folders written, read, recovered; the runs in them, resimulation; no ROS.

Each name is loaded when it is used.

MCAP files are written with ``mcap``, its records are parsed by it, and messages are decoded by
``mcap_ros2``. Walking over records and unpacking chunks is our own, for two measured reasons.
Safety: the readers of ``mcap`` 1.6 and ``rosbags`` 0.11 unpack a chunk to any size that it states,
lz4 without a limit, their limit on records does not hold for chunks found by the index, and both
give up at the first damage, where a recovery goes on with the next whole chunk. Speed: ``mcap``
yields a message in 17 us and ``mcap_ros2`` decodes joint states in 50; blocks of messages and
their layouts, taken apart by NumPy, take 2 us and 1, without which an export takes minutes.
"""

from typing import TYPE_CHECKING

from stickslip_ros.base.lazy_names import lazy_names

_PLACES = {
    "message_types": "STATUS_TYPE definition_from_fields nanoseconds schema_text",
    "cdr": "Status decoder_for statuses",
    "encoding": "encoder_for",
    "errors": "BagError",
    "mcap_records": "BagMessage",
    "metadata": "TopicDescription",
    "qos": "OfferedQos qos_yaml",
    "reader": "BagReader open_bag",
    "recovery": "Recovered bytes_of recover",
    "writer": "COMPRESSIONS BagWriter",
    "resimulation": "Resimulated resimulate",
    "runs": "describe recorded_axes recorded_runs recorded_states",
}

if TYPE_CHECKING:
    from stickslip_ros.recordings.cdr import Status, decoder_for, statuses
    from stickslip_ros.recordings.encoding import encoder_for
    from stickslip_ros.recordings.errors import BagError
    from stickslip_ros.recordings.mcap_records import BagMessage
    from stickslip_ros.recordings.message_types import (
        STATUS_TYPE,
        definition_from_fields,
        nanoseconds,
        schema_text,
    )
    from stickslip_ros.recordings.metadata import TopicDescription
    from stickslip_ros.recordings.qos import OfferedQos, qos_yaml
    from stickslip_ros.recordings.reader import BagReader, open_bag
    from stickslip_ros.recordings.recovery import Recovered, bytes_of, recover
    from stickslip_ros.recordings.resimulation import Resimulated, resimulate
    from stickslip_ros.recordings.runs import (
        describe,
        recorded_axes,
        recorded_runs,
        recorded_states,
    )
    from stickslip_ros.recordings.writer import COMPRESSIONS, BagWriter
else:
    __getattr__ = lazy_names(__name__, _PLACES)

__all__ = [
    "COMPRESSIONS",
    "STATUS_TYPE",
    "BagError",
    "BagMessage",
    "BagReader",
    "BagWriter",
    "OfferedQos",
    "Recovered",
    "Resimulated",
    "Status",
    "TopicDescription",
    "bytes_of",
    "decoder_for",
    "definition_from_fields",
    "describe",
    "encoder_for",
    "nanoseconds",
    "open_bag",
    "qos_yaml",
    "recorded_axes",
    "recorded_runs",
    "recorded_states",
    "recover",
    "resimulate",
    "schema_text",
    "statuses",
]
