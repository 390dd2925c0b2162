# SPDX-License-Identifier: Apache-2.0
"""Our bags as others read them, theirs as we do: topics, counts, QoS, hashes and values agree."""

import contextlib
import json
from collections import Counter
from pathlib import Path
from typing import Any, Literal

import pytest
from bags import EVENTS, JOINTS, SECOND, STEPS, TOPICS, by_rosbags, contents, expected, record
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.interfaces import ConnectionExtRosbag2
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

from stickslip_ros.recordings import (
    OfferedQos,
    TopicDescription,
    decoder_for,
    open_bag,
    recover,
)
from stickslip_ros.recordings.metadata import qos_yaml

OPTIONS: list[dict[str, Any]] = [
    {},
    {"compression": "zstd"},
    {"compression": "lz4"},
    {"compression": "lz4", "max_duration_ns": SECOND // 4},
    {"max_bytes": 49_152},
]
KINDS = ["plain", "zstd", "lz4", "split, lz4", "split by size"]


@pytest.fixture(params=OPTIONS, ids=KINDS)
def bag(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A bag of a thousand messages on three topics, and one that is silent."""
    record(tmp_path / "run", **request.param)
    assert (len(list((tmp_path / "run").glob("*.mcap"))) > 1) == (len(request.param) > 1) or (
        "max_bytes" in request.param
    )
    return tmp_path / "run"


def counted(bag: Path) -> dict[str, int]:
    with open_bag(bag) as ours:
        return ours.counts


def values(topic: str, message: Any) -> Any:
    """What is compared of a message."""
    if topic == STEPS.name:
        return message.data
    stamp = message.header.stamp.sec, message.header.stamp.nanosec
    if topic == JOINTS.name:
        return stamp, list(message.name), list(message.position), list(message.effort)
    return stamp, [
        (status.name, [(pair.key, pair.value) for pair in status.values])
        for status in message.status
    ]


def test_rosbags_agrees(bag: Path) -> None:
    with AnyReader([bag]) as theirs, open_bag(bag) as ours:
        assert {c.topic: c.msgcount for c in theirs.connections} == ours.counts
        for connection in theirs.connections:
            topic = ours.topics[connection.topic]
            assert (connection.msgtype, connection.digest) == (topic.type, topic.type_hash)
            assert isinstance(connection.ext, ConnectionExtRosbag2)
            assert [
                (*(word.name.lower() for word in (q.reliability, q.durability, q.history)), q.depth)
                for q in connection.ext.offered_qos_profiles
            ] == [(q.reliability, q.durability, q.history, q.depth) for q in topic.offered_qos]
        decoders = {name: decoder_for(t) for name, t in ours.topics.items() if ours.counts[name]}
        for (connection, ns, data), message in zip(theirs.messages(), ours.messages(), strict=True):
            assert (connection.topic, ns, bytes(data)) == (*message[:2], message.data)
            assert values(connection.topic, theirs.deserialize(data, connection.msgtype)) == values(
                message.topic, decoders[message.topic](message.data)
            )


def test_mcap_agrees(bag: Path) -> None:
    counts: Counter[str] = Counter()
    for file in sorted(bag.glob("*.mcap")):
        with file.open("rb") as stream:
            reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
            summary = reader.get_summary()
            assert summary is not None and summary.statistics is not None
            for channel in summary.channels.values():
                topic = next(topic for topic in TOPICS if topic.name == channel.topic)
                assert channel.metadata == {
                    "offered_qos_profiles": qos_yaml(topic.offered_qos),
                    "topic_type_hash": topic.type_hash,
                }
                schema = summary.schemas[channel.schema_id]
                assert (schema.name, schema.data.decode()) == (topic.type, topic.schema)
            with open_bag(file) as ours:
                decoders = {t.name: decoder_for(t) for t in ours.topics.values() if t.schema}
                for (_, channel, _, theirs), message in zip(
                    reader.iter_decoded_messages(), ours.messages(), strict=True
                ):
                    counts[channel.topic] += 1
                    found = values(message.topic, decoders[message.topic](message.data))
                    assert values(channel.topic, theirs) == found
    assert {**dict.fromkeys(counted(bag), 0), **counts} == counted(bag)


def test_pymcap_finds_nothing_wrong(bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = pytest.importorskip("pymcap_cli.cli").app
    for file in sorted(bag.glob("*.mcap")):
        with contextlib.suppress(SystemExit):
            assert not command(["doctor", "--format", "jsonl", str(file)])
        *findings, summary = map(json.loads, capsys.readouterr().out.splitlines())
        assert (summary["type"], summary["errors"]) == ("summary", 0)
        # rosbag2 leaves its metadata twice as well, at the beginning and at the end.
        warnings = {one["code"] for one in findings if one["severity"] == "warning"}
        assert warnings <= {"METADATA_NAME_DUPLICATE"}


def test_every_policy_comes_back(tmp_path: Path) -> None:
    """A QoS with nothing at its default, and an event topic as a node offers it."""
    from stickslip_ros.recordings import BagWriter

    odd = OfferedQos(
        reliability="best_effort",
        durability="transient_local",
        history="keep_all",
        depth=7,
        deadline_ns=1_500_000_000,
        lifespan_ns=3,
        liveliness="manual_by_topic",
        liveliness_lease_duration_ns=2 * SECOND,
        avoid_ros_namespace_conventions=True,
    )
    topic = TopicDescription(
        "/odd", STEPS.type, STEPS.schema, STEPS.type_hash, (odd, *EVENTS.offered_qos)
    )
    with BagWriter(tmp_path / "run") as writer:
        writer.add_topic(topic)
        writer.write("/odd", b"\x00\x01\x00\x00" + bytes(4), log_ns=1, publish_ns=1)
    for path in (tmp_path / "run", tmp_path / "run" / "run_0.mcap"):
        with open_bag(path) as bag:
            assert bag.topics["/odd"] == topic


@pytest.mark.parametrize("version", [8, 9])
@pytest.mark.parametrize("mode", ["none", "storage", "file", "message"])
def test_bags_of_rosbags_are_read(tmp_path: Path, version: Literal[8, 9], mode: str) -> None:
    """In every kind of compression that rosbag2 knows."""
    writer = Writer(tmp_path / "run", version=version, storage_plugin=StoragePlugin.MCAP)
    if mode != "none":
        writer.set_compression(CompressionMode[mode.upper()], CompressionFormat.ZSTD)
    written = by_rosbags(writer)
    yaml_file = tmp_path / "run" / "metadata.yaml"
    text = yaml_file.read_text()
    yaml_file.write_text(text.replace("compression_mode: file", "compression_mode: FILE"))
    assert contents(tmp_path / "run") == expected(written)
    with open_bag(tmp_path / "run") as bag:
        assert bag.counts == {
            topic.name: sum(one is topic for one, _, _ in written) for topic in TOPICS
        }
        assert {name: topic.type_hash for name, topic in bag.topics.items()} == {
            topic.name: topic.type_hash for topic in TOPICS
        }
        assert bag.custom_data == {"seed": "7"}
        assert decoder_for(bag.topics[STEPS.name])(next(bag.messages([STEPS.name])).data).data == 7
    done = recover(tmp_path / "run")
    assert (done.messages, done.dropped_bytes) == (len(written), 0)
    assert contents(done.folder) == expected(written)
