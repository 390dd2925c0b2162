# SPDX-License-Identifier: Apache-2.0
"""Recordings: rosbag2 folders written, read, recovered; the runs in them, resimulation; no ROS."""

from typing import TYPE_CHECKING

from stickslip_ros.lazy_names import lazy_names
from stickslip_ros.recordings.cdr import (
    STATUS_TYPE,
    Status,
    decoder_for,
    definition_from_fields,
    encoder_for,
    nanoseconds,
    schema_text,
    statuses,
)
from stickslip_ros.recordings.errors import BagError
from stickslip_ros.recordings.mcap_records import BagMessage
from stickslip_ros.recordings.metadata import TopicDescription
from stickslip_ros.recordings.qos import OfferedQos, qos_yaml
from stickslip_ros.recordings.reader import BagReader, open_bag
from stickslip_ros.recordings.recovery import Recovered, bytes_of, recover
from stickslip_ros.recordings.writer import COMPRESSIONS, BagWriter

if TYPE_CHECKING:
    from stickslip_ros.recordings.resimulation import Resimulated, resimulate
    from stickslip_ros.recordings.runs import (
        describe,
        recorded_axes,
        recorded_runs,
        recorded_states,
    )

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

_PLACES = {
    "resimulation": "Resimulated resimulate",
    "runs": "describe recorded_axes recorded_runs recorded_states",
}
if not TYPE_CHECKING:  # what needs the axis, whose compiled parts take a second to load
    __getattr__ = lazy_names(__name__, _PLACES)
