# SPDX-License-Identifier: Apache-2.0
"""Quality of service of a publisher, in the words rosbag2 metadata version 9 uses for it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypedDict

import yaml

INFINITE_NS = 2**63 - 1
"""Nanoseconds that stand for 'no limit' (rosbag2 shows them as 9223372036 s 854775807 ns)."""

_NS_PER_S = 1_000_000_000


class QosTimeDict(TypedDict):
    """A duration: whole seconds and the nanoseconds left over."""

    sec: int
    nsec: int


class QosDict(TypedDict):
    """One offered QoS profile as it stands in ``metadata.yaml``."""

    history: str
    depth: int
    reliability: str
    durability: str
    deadline: QosTimeDict
    lifespan: QosTimeDict
    liveliness: str
    liveliness_lease_duration: QosTimeDict
    avoid_ros_namespace_conventions: bool


@dataclass(frozen=True)
class OfferedQos:
    """What one publisher offers; policies by their rmw names, durations in nanoseconds.

    History and depth are not part of DDS discovery, so a recorder usually sees ``unknown`` and 0,
    and rosbag2 writes them that way too.
    """

    reliability: str = "reliable"
    durability: str = "volatile"
    history: str = "unknown"
    depth: int = 0
    deadline_ns: int = INFINITE_NS
    lifespan_ns: int = INFINITE_NS
    liveliness: str = "automatic"
    liveliness_lease_ns: int = INFINITE_NS
    avoid_ros_namespace_conventions: bool = False

    def as_dict(self) -> QosDict:
        """Return the profile with the keys, and in the order, of rosbag2."""
        return {
            "history": self.history,
            "depth": self.depth,
            "reliability": self.reliability,
            "durability": self.durability,
            "deadline": _qos_time(self.deadline_ns),
            "lifespan": _qos_time(self.lifespan_ns),
            "liveliness": self.liveliness,
            "liveliness_lease_duration": _qos_time(self.liveliness_lease_ns),
            "avoid_ros_namespace_conventions": self.avoid_ros_namespace_conventions,
        }


def qos_yaml(profiles: Sequence[OfferedQos]) -> str:
    """Return the YAML list that goes into the metadata of an MCAP channel."""
    return str(yaml.safe_dump([profile.as_dict() for profile in profiles], sort_keys=False))


def _qos_time(nanoseconds: int) -> QosTimeDict:
    sec, nsec = divmod(nanoseconds, _NS_PER_S)
    return {"sec": sec, "nsec": nsec}
