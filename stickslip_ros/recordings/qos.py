# SPDX-License-Identifier: Apache-2.0
"""Quality of service of a publisher: written in words, read as every distribution keeps it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypedDict

import yaml

from stickslip_ros.parameters.bounded_yaml import load_texts
from stickslip_ros.recordings.yaml_values import integer, mapping, sequence, text_of

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


# Up to Iron the policies stood there as the numbers of the rmw enumerations.
_WORDS = {
    name: ("system_default", *words.split())
    for name, words in {
        "history": "keep_last keep_all unknown",
        "reliability": "reliable best_effort unknown best_available",
        "durability": "transient_local volatile unknown best_available",
        "liveliness": "automatic manual_by_node manual_by_topic unknown best_available",
    }.items()
}


def profiles_in_yaml(text: str) -> tuple[OfferedQos, ...]:
    """Return the profiles in a YAML list, as it stands in the metadata of a channel.

    :raises ValueError: it is no such list.
    """
    return profiles(load_texts(text)) if text.strip() else ()


def profiles(value: Any) -> tuple[OfferedQos, ...]:
    """Return the profiles in a list of mappings of texts, or in a text that holds one.

    :raises ValueError: it is no such list.
    """
    if isinstance(value, str):  # as in metadata.yaml up to version 8
        return profiles_in_yaml(value)
    return tuple(_profile(mapping(one, "a QoS profile")) for one in sequence(value, "QoS profiles"))


def _profile(found: dict[str, Any]) -> OfferedQos:
    switch = found.get("avoid_ros_namespace_conventions", "false")
    return OfferedQos(
        reliability=_policy(found, "reliability"),
        durability=_policy(found, "durability"),
        history=_policy(found, "history"),
        liveliness=_policy(found, "liveliness"),
        depth=integer(found.get("depth", "0"), "the QoS depth"),
        deadline_ns=_duration(found, "deadline"),
        lifespan_ns=_duration(found, "lifespan"),
        liveliness_lease_ns=_duration(found, "liveliness_lease_duration"),
        avoid_ros_namespace_conventions=text_of(switch, "a QoS switch").lower() == "true",
    )


def _policy(found: dict[str, Any], name: str) -> str:
    word = text_of(found.get(name, getattr(OfferedQos, name)), f"the QoS {name}")
    if not word.isdecimal():
        return word
    number = integer(word, f"the QoS {name}")
    return _WORDS[name][number] if number < len(_WORDS[name]) else "unknown"


def _duration(found: dict[str, Any], name: str) -> int:
    if name not in found:
        return INFINITE_NS
    parts = mapping(found[name], f"the QoS {name}")
    sec, nsec = (integer(parts.get(key, "0"), f"the QoS {name}") for key in ("sec", "nsec"))
    return min(sec * _NS_PER_S + nsec, INFINITE_NS)
