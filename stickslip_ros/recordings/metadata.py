# SPDX-License-Identifier: Apache-2.0
"""What a bag says of itself: ``metadata.yaml``, the QoS of its topics, which storage files it has.

Metadata are written in version 9 and read in every version.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import yaml

from stickslip_ros.base.opening import open_regular
from stickslip_ros.physics.parameters.bounded_files import load_texts
from stickslip_ros.recordings.errors import BagError, reading, short

METADATA_FILE = "metadata.yaml"
METADATA_VERSION = 9
"""The version that is written, and the newest that is read."""

OUTER_KEY = "rosbag2_bagfile_information"
"""The key of ``metadata.yaml`` that holds the metadata of a bag."""

# As much YAML as is read anywhere. That of 1500 topics is longer, but can be done without.
_METADATA_BYTES = 1024 * 1024
#: Ends of the names of storage files, by the word of ``metadata.yaml`` for their kind
_ENDS = {"mcap": (".mcap", ".mcap.zstd"), "sqlite3": (".db3",)}
_STARTS = {b"\x89MCAP0": "mcap", b"SQLite format 3\0": "sqlite3", b"#ROSBAG V": "ros1"}
_INFINITE_NS = 2**63 - 1  # no limit; rosbag2 shows it as 9223372036 s 854775807 ns
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


@dataclass(frozen=True)
class OfferedQos:
    """The QoS of one publisher; policies by their rmw names, durations in nanoseconds.

    History and depth are not part of DDS discovery, so a recorder usually sees ``unknown`` and 0,
    and rosbag2 writes them that way too. The fields are in the order of rosbag2.
    """

    history: str = "unknown"
    depth: int = 0
    reliability: str = "reliable"
    durability: str = "volatile"
    deadline_ns: int = _INFINITE_NS
    lifespan_ns: int = _INFINITE_NS
    liveliness: str = "automatic"
    liveliness_lease_duration_ns: int = _INFINITE_NS
    avoid_ros_namespace_conventions: bool = False

    def as_json(self) -> dict[str, Any]:
        """Return the profile with the keys of rosbag2."""
        return {
            name.removesuffix("_ns"): dict(zip(("sec", "nsec"), divmod(value, 10**9), strict=True))
            if name.endswith("_ns")
            else value
            for name, value in vars(self).items()
        }


def is_kept(offers: Sequence[OfferedQos]) -> bool:
    """Return whether late subscribers get the messages of a topic, which are older than they."""
    return bool(offers) and all(offer.durability == "transient_local" for offer in offers)


@dataclass(frozen=True)
class TopicDescription:
    """A topic as a bag keeps it."""

    name: str
    type: str  #: such as ``sensor_msgs/msg/JointState``
    schema: str  #: the ``ros2msg`` text of the type with everything inside it
    type_hash: str = ""  #: ``RIHS01_...``, empty when not known
    offered_qos: tuple[OfferedQos, ...] = ()  #: one entry a publisher
    schema_encoding: str = "ros2msg"  #: the language of the schema
    encoding: str = "cdr"  #: the format of the messages


@dataclass
class FileSummary:
    """Name of a storage file, its size on the disk (bytes, 0 while it is written), how many
    messages it has, from when to when (log times in ns, 0 without messages)."""

    name: str
    size: int = 0
    messages: int = 0
    start_ns: int = 0
    end_ns: int = 0


# -- writing


def bag_metadata(
    files: Sequence[FileSummary],
    topics: Sequence[tuple[TopicDescription, int]],
    ros_distro: str,
    custom_data: Mapping[str, str],
) -> dict[str, Any]:
    """Return the metadata of a bag of MCAP files; rosbag2 needs every key.

    files: every storage file, in order of time.
    topics: every topic with the count of its messages.
    custom_data: free text by key, kept as it is.
    """
    filled = [file for file in files if file.messages]
    start = min((file.start_ns for file in filled), default=0)
    end = max((file.end_ns for file in filled), default=0)
    return {
        "version": METADATA_VERSION,
        "storage_identifier": "mcap",
        "duration": {"nanoseconds": end - start},
        "starting_time": {"nanoseconds_since_epoch": start},
        "message_count": sum(file.messages for file in files),
        "topics_with_message_count": [
            {
                "topic_metadata": {
                    "name": topic.name,
                    "type": topic.type,
                    "serialization_format": topic.encoding,
                    "offered_qos_profiles": [profile.as_json() for profile in topic.offered_qos],
                    "type_description_hash": topic.type_hash,
                },
                "message_count": count,
            }
            for topic, count in topics
        ],
        # These two are about rosbag2 packing whole files or messages, not about MCAP chunks.
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file.name for file in files],
        "files": [
            {
                "path": file.name,
                "starting_time": {"nanoseconds_since_epoch": file.start_ns},
                "duration": {"nanoseconds": file.end_ns - file.start_ns},
                "message_count": file.messages,
            }
            for file in files
        ],
        "custom_data": dict(custom_data),
        "ros_distro": ros_distro,
    }


@lru_cache(maxsize=256)  # thousands of topics offer the same
def qos_yaml(profiles: tuple[OfferedQos, ...]) -> str:
    """Return the YAML list that goes into the metadata of an MCAP channel."""
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


# -- reading: every value is a text, and what a stranger wrote


def _get(found: Any, name: str, kind: type, default: Any = None) -> Any:
    """Return a field of a mapping: a str, int, list or dict; its default, or an empty one, if it
    is missing or null, which rosbag2 writes. Raises ValueError: it is another kind."""
    if not isinstance(found, dict):
        raise ValueError(f"what holds {name} has to be a mapping")
    value = found.get(name)
    if value in (None, "", "~", "null"):
        return kind() if default is None else default
    if kind is int and isinstance(value, str):
        # A text of thousands of digits takes long to be understood.
        if not re.fullmatch(r"-?[0-9]{1,30}", value) or not -(2**63) <= int(value) < 2**64:
            raise ValueError(f"{name} is {value[:30]!r}; it has to be a whole number of 64 bits")
        return int(value)
    if not isinstance(value, kind):
        kinds = {str: "a single value", int: "a single value", list: "a list", dict: "a mapping"}
        raise ValueError(f"{name} has to be {kinds[kind]}")
    return value


@dataclass(frozen=True)
class StoredMetadata:
    """The part of the metadata that the files of the bag do not contain."""

    version: int = METADATA_VERSION
    storage: str = "mcap"
    #: of the storage files; some versions put the folder, in which they lie in any case, in front
    names: frozenset[str] = frozenset()
    #: by name, without schemas, which stand in the files
    topics: dict[str, TopicDescription] = field(default_factory=dict)
    compression_format: str = ""
    #: "", "file" or "message": rosbag2's own, around or inside the files
    compression_mode: str = ""
    ros_distro: str = ""
    custom_data: dict[str, str] = field(default_factory=dict)
    message_count: int | None = None  #: in all files, None if it is not said

    def completed(self, topic: TopicDescription) -> TopicDescription:
        """Return a topic with the hash and the QoS given here if its file does not give any."""
        stored = self.topics.get(topic.name, topic)
        return replace(
            topic,
            type_hash=topic.type_hash or stored.type_hash,
            offered_qos=topic.offered_qos or stored.offered_qos,
        )


def parse_metadata(text: str) -> StoredMetadata:
    """Parse a ``metadata.yaml``, or its copy inside a storage file.

    Raises ValueError: the text names what is wrong with it.
    """
    found = load_texts(text) or {}
    if not isinstance(found, dict) or (OUTER_KEY not in found and "version" not in found):
        raise ValueError(f"it has no {OUTER_KEY}")
    found = _get(found, OUTER_KEY, dict, found)
    custom = _get(found, "custom_data", dict)
    files, entry = _get(found, "relative_file_paths", list), "an entry of relative_file_paths"
    topics = _get(found, "topics_with_message_count", list)
    return StoredMetadata(
        version=_get(found, "version", int),
        storage=_get(found, "storage_identifier", str),
        names=frozenset(Path(_get({entry: one}, entry, str)).name for one in files),
        topics={topic.name: topic for topic in map(_topic, topics)},
        compression_format=_get(found, "compression_format", str),
        compression_mode=_get(found, "compression_mode", str).lower(),
        ros_distro=_get(found, "ros_distro", str),
        custom_data={key: _get(custom, key, str) for key in custom},
        message_count=_get(found, "message_count", int) if "message_count" in found else None,
    )


def _topic(entry: Any) -> TopicDescription:
    found = _get(entry, "topic_metadata", dict)
    offered = found.get("offered_qos_profiles") or ""
    return TopicDescription(
        name=_get(found, "name", str),
        type=_get(found, "type", str),
        schema="",
        type_hash=_get(found, "type_description_hash", str),
        offered_qos=qos_profiles(offered) if isinstance(offered, str) else _profiles(offered),
        encoding=_get(found, "serialization_format", str, "cdr"),
    )


@lru_cache(maxsize=256)
def qos_profiles(text: str) -> tuple[OfferedQos, ...]:
    """Return the profiles in a YAML list, as channels have it, and ``metadata.yaml`` up to 8.

    Raises ValueError: it is no such list.
    """
    return _profiles(load_texts(text) if text.strip() else [])


def _profiles(value: Any) -> tuple[OfferedQos, ...]:
    return tuple(map(_profile, _get({"QoS profiles": value}, "QoS profiles", list)))


def _profile(found: Any) -> OfferedQos:
    values: dict[str, Any] = {"depth": _get(found, "depth", int)}
    for name, words in _WORDS.items():
        values[name] = _get(found, name, str, getattr(OfferedQos, name))
        if values[name].isdecimal():
            number = _get(found, name, int)
            values[name] = words[number] if number < len(words) else "unknown"
    for name in ("deadline", "lifespan", "liveliness_lease_duration"):
        if name in found:
            parts = _get(found, name, dict)
            ns = _get(parts, "sec", int) * 10**9 + _get(parts, "nsec", int)
            values[f"{name}_ns"] = min(ns, _INFINITE_NS)
    avoids = _get(found, "avoid_ros_namespace_conventions", str).lower() == "true"
    return OfferedQos(**values, avoid_ros_namespace_conventions=avoids)


# -- the folder


def stored_metadata(path: Path) -> StoredMetadata | None:
    """Read the ``metadata.yaml`` of a bag, None if there is none, or one too long to be read.

    Raises BagError: it cannot be read or is broken.
    """
    file = path / METADATA_FILE
    if not path.is_dir() or not file.exists():
        return None
    with reading(file), open_regular(file) as stream:
        content = stream.read(_METADATA_BYTES + 1)
    if len(content) > _METADATA_BYTES:
        return None
    try:
        return parse_metadata(content.decode())
    except ValueError as error:
        raise BagError(
            f"{file} is not what rosbag2 writes: {short(error)}; repair it, or move it away: "
            "the bag can be read without it"
        ) from error


def storage_files(path: Path, stored: StoredMetadata | None = None) -> list[Path]:
    """Return the storage files of a bag, all of one kind, in the order of their numbers.

    path: a folder, or one file; stored: what ``metadata.yaml`` says, which names the kind. Raises
    BagError: there is none.
    """
    if not path.exists():
        raise BagError(f"there is no bag {path}; check the name")
    if not path.is_dir():
        return [path]
    said = stored.storage if stored else "mcap"
    with reading(path):
        files = sorted(path.iterdir(), key=_numbered)
    for ends in (_ENDS.get(said, ()), *_ENDS.values()):  # what is said may be wrong
        if found := [file for file in files if file.name.endswith(ends)]:
            return found
    if said not in _ENDS:
        raise BagError(
            f"{path} is stored as {said}, of which it has no file that can be read; make "
            f"an MCAP bag of it with `ros2 bag convert -i {path} -o OPTIONS.yaml`, where "
            "OPTIONS.yaml says output_bags: [{uri: NEW, storage_id: mcap, all_topics: true}]"
        )
    raise BagError(
        f"there is no .mcap or .db3 file in {path}; name the folder of a bag, or tables "
        f"by their files ({path}/*.csv)"
    )


def differences(
    stored: StoredMetadata, files: list[Path], kind: str, messages: int
) -> Iterator[str]:
    """Yield what ``metadata.yaml`` says otherwise than the storage files, the worst first."""
    found = {file.name for file in files}
    if missing := ", ".join(sorted(stored.names - found)):
        yield f"{METADATA_FILE} names {missing}, which is not there"
    if stored.names and (others := ", ".join(sorted(found - stored.names))):
        yield (f"{METADATA_FILE} does not name {others}, which `stickslip bag recover` alone takes")
    if stored.message_count not in (None, messages):
        yield f"{METADATA_FILE} counts {stored.message_count} messages, {messages} were found"
    if stored.storage != kind:
        said = stored.storage or "nothing"
        yield f"{METADATA_FILE} says {said} of its storage, but {files[0].name} is {kind}"


def storage_of(file: Path) -> str:
    """Return what a storage file is, as ``metadata.yaml`` calls it, or "ros1"; by its first bytes.

    One that begins as none of them is what its name says, mcap without a word of it.

    Raises ReadError, OSError: it cannot be read.
    """
    with open_regular(file) as stream:
        start = stream.read(16)
    by_start = next((kind for mark, kind in _STARTS.items() if start.startswith(mark)), "")
    return by_start or {".db3": "sqlite3", ".bag": "ros1"}.get(file.suffix, "mcap")


def _numbered(path: Path) -> list[tuple[int, str]]:
    """Sort bag_2 before bag_10."""
    parts = re.split(r"(\d+)", path.name)
    return [(int(part[:300]), "") if part.isdecimal() else (-1, part) for part in parts]
