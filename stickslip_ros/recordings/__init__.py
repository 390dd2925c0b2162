# SPDX-License-Identifier: Apache-2.0
"""rosbag2 folders with MCAP files: writing, reading, mending; knows no ROS and no physics."""

from stickslip_ros.recordings.cdr import decoder_for, encoder_for, nanoseconds
from stickslip_ros.recordings.errors import BagError
from stickslip_ros.recordings.mcap_file import COMPRESSIONS
from stickslip_ros.recordings.metadata import (
    METADATA_FILE,
    BagMetadata,
    TopicDescription,
    metadata_yaml,
    write_metadata,
)
from stickslip_ros.recordings.open_span import BagMessage
from stickslip_ros.recordings.qos import INFINITE_NS, OfferedQos, qos_yaml
from stickslip_ros.recordings.reader import BagReader, open_bag
from stickslip_ros.recordings.recovery import Recovered, bytes_of, recover, recovered_name
from stickslip_ros.recordings.schema import definition_from_fields, referenced_types, schema_text
from stickslip_ros.recordings.statuses import STATUS_TYPE, Status, statuses
from stickslip_ros.recordings.writer import BagWriter

__all__ = [
    "COMPRESSIONS",
    "INFINITE_NS",
    "METADATA_FILE",
    "STATUS_TYPE",
    "BagError",
    "BagMessage",
    "BagMetadata",
    "BagReader",
    "BagWriter",
    "OfferedQos",
    "Recovered",
    "Status",
    "TopicDescription",
    "bytes_of",
    "decoder_for",
    "definition_from_fields",
    "encoder_for",
    "metadata_yaml",
    "nanoseconds",
    "open_bag",
    "qos_yaml",
    "recover",
    "recovered_name",
    "referenced_types",
    "schema_text",
    "statuses",
    "write_metadata",
]
