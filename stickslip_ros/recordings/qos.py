# SPDX-License-Identifier: Apache-2.0
"""Quality of service of a publisher: written in words, read as every distribution keeps it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import yaml

from stickslip_ros.physics.parameters.bounded_files import load_texts

_INFINITE_NS = 2**63 - 1  # no limit; rosbag2 shows it as 9223372036 s 854775807 ns
_NS_PER_S = 1_000_000_000
# As Python, it took most of the time in which a recorder ends; that in C is not in every PyYAML.
_DUMPER: Any = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
#: Words for the policies, which bags up to Iron hold as numbers of the enumerations of rmw.
_WORDS = {
    name: ("system_default", *words.split())
    for name, words in {
        "history": "keep_last keep_all unknown",
        "reliability": "reliable best_effort unknown best_available",
        "durability": "transient_local volatile unknown best_available",
        "liveliness": "automatic manual_by_node manual_by_topic unknown best_available",
    }.items()
}
#: The keys of rosbag2 in its order, and the fields of :class:`OfferedQos`
_FIELDS = {
    "history": "history",
    "depth": "depth",
    "reliability": "reliability",
    "durability": "durability",
    "deadline": "deadline_ns",
    "lifespan": "lifespan_ns",
    "liveliness": "liveliness",
    "liveliness_lease_duration": "liveliness_lease_ns",
    "avoid_ros_namespace_conventions": "avoid_ros_namespace_conventions",
}


class YamlFields:
    """The fields of a YAML mapping of texts; a wrong type raises a ValueError.

    Missing fields and null, which rosbag2 writes, are empty.
    """

    def __init__(self, value: Any, what: str) -> None:
        """Take a value that has to be a mapping with texts as keys; ``what`` names it in errors."""
        value = {} if _is_nothing(value) else value
        if not isinstance(value, dict) or not all(isinstance(key, str) for key in value):
            raise ValueError(f"{what} has to be a mapping")
        self.values: dict[str, Any] = value
        self._what = what

    def inside(self, name: str) -> YamlFields:
        """Return a field that is a mapping itself."""
        return YamlFields(self.values.get(name), name)

    def each(self, name: str) -> list[Any]:
        """Return a field that is a list."""
        return items(self.values.get(name), name)

    def text(self, name: str, default: str = "") -> str:
        """Return a field that is a single value."""
        found = self.values.get(name, default)
        if not isinstance(found, str):
            raise ValueError(f"{self._what}: {name} has to be a single value")
        return found

    def integer(self, name: str, default: int = 0) -> int:
        """Return a field that is a whole number of 64 bits."""
        text = self.text(name, str(default))
        # A text of thousands of digits takes long to be understood.
        whole = text.removeprefix("-").isdecimal() and len(text) < 30
        if not whole or not -(2**63) <= int(text) < 2**64:
            raise ValueError(f"{name} is {text[:30]!r}; it has to be a whole number of 64 bits")
        return int(text)


def items(value: Any, what: str) -> list[Any]:
    """Return a value that has to be a list; ValueError if it is not."""
    value = [] if _is_nothing(value) else value
    if not isinstance(value, list):
        raise ValueError(f"{what} has to be a list")
    return value


def _is_nothing(value: Any) -> bool:
    return value is None or (isinstance(value, str) and value in ("", "~", "null"))


@dataclass(frozen=True)
class OfferedQos:
    """The QoS of one publisher; policies by their rmw names, durations in nanoseconds.

    History and depth are not part of DDS discovery, so a recorder usually sees ``unknown`` and 0,
    and rosbag2 writes them that way too.
    """

    reliability: str = "reliable"
    durability: str = "volatile"
    history: str = "unknown"
    depth: int = 0
    deadline_ns: int = _INFINITE_NS
    lifespan_ns: int = _INFINITE_NS
    liveliness: str = "automatic"
    liveliness_lease_ns: int = _INFINITE_NS
    avoid_ros_namespace_conventions: bool = False

    def as_json(self) -> dict[str, Any]:
        """Return the profile with the keys, and in the order, of rosbag2."""
        found = {key: getattr(self, name) for key, name in _FIELDS.items()}
        for key, name in _FIELDS.items():
            if name.endswith("_ns"):
                found[key] = dict(zip(("sec", "nsec"), divmod(found[key], _NS_PER_S), strict=True))
        return found


def qos_yaml(profiles: Sequence[OfferedQos]) -> str:
    """Return the YAML list that goes into the metadata of an MCAP channel."""
    return _qos_yaml(tuple(profiles))


@lru_cache(maxsize=256)  # thousands of topics offer the same
def _qos_yaml(profiles: tuple[OfferedQos, ...]) -> str:
    return yaml_text([profile.as_json() for profile in profiles])


def yaml_text(value: Any) -> str:
    """Return plain values as YAML.

    The entries of lists in a mapping are written one by one: the nodes of thousands of topics, all
    at once, fill the memory.
    """
    if isinstance(value, dict):
        parts = [
            f"{key}:\n{''.join(yaml_text([one]) for one in inner)}"
            if isinstance(inner, list) and inner
            else str(yaml.dump({key: inner}, Dumper=_DUMPER, sort_keys=False))
            for key, inner in value.items()
        ]
        return "".join(parts) or "{}\n"
    return str(yaml.dump(value, Dumper=_DUMPER, sort_keys=False))


def qos_profiles(value: Any) -> tuple[OfferedQos, ...]:
    """Return the profiles in a list of mappings of texts, or in YAML text that holds one.

    Text stands in the metadata of channels, and in ``metadata.yaml`` up to version 8.

    Raises ValueError: it is no such list.
    """
    return _qos_in(value) if isinstance(value, str) else _qos_of(value)


@lru_cache(maxsize=256)
def _qos_in(text: str) -> tuple[OfferedQos, ...]:
    return _qos_of(load_texts(text) if text.strip() else [])


def _qos_of(value: Any) -> tuple[OfferedQos, ...]:
    return tuple(_profile(YamlFields(one, "a QoS profile")) for one in items(value, "QoS profiles"))


def _profile(found: YamlFields) -> OfferedQos:
    values: dict[str, Any] = {"depth": found.integer("depth")}
    for name, words in _WORDS.items():
        values[name] = found.text(name, getattr(OfferedQos, name))
        if values[name].isdecimal():
            number = found.integer(name)
            values[name] = words[number] if number < len(words) else "unknown"
    for key, name in _FIELDS.items():
        if name.endswith("_ns") and key in found.values:
            parts = found.inside(key)
            ns = parts.integer("sec") * _NS_PER_S + parts.integer("nsec")
            values[name] = min(ns, _INFINITE_NS)
    avoids = found.text("avoid_ros_namespace_conventions").lower() == "true"
    return OfferedQos(**values, avoid_ros_namespace_conventions=avoids)
