# SPDX-License-Identifier: Apache-2.0
"""rosbag2 folders with MCAP files: schema text, metadata, writer; knows no ROS and no physics."""

from stickslip_ros.bag.errors import BagError
from stickslip_ros.bag.metadata import (
    METADATA_FILE,
    BagMetadata,
    TopicDescription,
    metadata_yaml,
    write_metadata,
)
from stickslip_ros.bag.qos import INFINITE_NS, OfferedQos, qos_yaml
from stickslip_ros.bag.schema import definition_from_fields, referenced_types, schema_text
from stickslip_ros.bag.writer import BagWriter

__all__ = [
    "INFINITE_NS",
    "METADATA_FILE",
    "BagError",
    "BagMetadata",
    "BagWriter",
    "OfferedQos",
    "TopicDescription",
    "definition_from_fields",
    "metadata_yaml",
    "qos_yaml",
    "referenced_types",
    "schema_text",
    "write_metadata",
]
