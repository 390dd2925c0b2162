# SPDX-License-Identifier: Apache-2.0
"""Recordings: rosbag2 folders written, read, recovered; the runs in them, resimulation; no ROS.

Each name is loaded when it is used.
"""

from typing import TYPE_CHECKING

from stickslip_ros.lazy_names import lazy_names

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
