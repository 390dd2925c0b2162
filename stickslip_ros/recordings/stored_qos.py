# SPDX-License-Identifier: Apache-2.0
"""Quality of service as bags of every ROS 2 distribution keep it: in words, or in numbers."""

from __future__ import annotations

from typing import Any

from stickslip_ros.parameters.bounded_yaml import load_texts
from stickslip_ros.recordings.qos import INFINITE_NS, OfferedQos
from stickslip_ros.recordings.yaml_text import integer, mapping, sequence, text_of

# Up to Iron the policies stood there as the numbers of the rmw enumerations.
_WORDS = {
    "history": ("system_default", "keep_last", "keep_all", "unknown"),
    "reliability": ("system_default", "reliable", "best_effort", "unknown", "best_available"),
    "durability": ("system_default", "transient_local", "volatile", "unknown", "best_available"),
    "liveliness": (
        "system_default",
        "automatic",
        "manual_by_node",
        "manual_by_topic",
        "unknown",
        "best_available",
    ),
}
_NS_PER_S = 1_000_000_000


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
    default = OfferedQos()
    return OfferedQos(
        reliability=_policy(found, "reliability", default.reliability),
        durability=_policy(found, "durability", default.durability),
        history=_policy(found, "history", default.history),
        depth=integer(found.get("depth", "0"), "the QoS depth"),
        deadline_ns=_duration(found, "deadline"),
        lifespan_ns=_duration(found, "lifespan"),
        liveliness=_policy(found, "liveliness", default.liveliness),
        liveliness_lease_ns=_duration(found, "liveliness_lease_duration"),
        avoid_ros_namespace_conventions=text_of(
            found.get("avoid_ros_namespace_conventions", "false"), "a QoS switch"
        ).lower()
        == "true",
    )


def _policy(found: dict[str, Any], name: str, default: str) -> str:
    word = text_of(found.get(name, default), f"the QoS {name}")
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
