# SPDX-License-Identifier: Apache-2.0
"""Bags as others see them: ``rosbags``, MCAP's own reader, and the plain YAML."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml
from bags import SECOND, START, STEPS, STORE, int32, topic
from mcap.reader import make_reader
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from rosbags.rosbag2 import Reader, StoragePlugin, Writer

from stickslip_ros.recordings import BagError, BagWriter, OfferedQos

INT32 = topic(
    "/axis/command/steps",
    "std_msgs/msg/Int32",
    OfferedQos(),
    OfferedQos(reliability="best_effort", durability="transient_local"),
)

NAMES = (INT32.name, "/silent")


def _write(folder: Path, count: int) -> None:
    with BagWriter(folder, custom_data={"seed": "7"}) as bag:
        bag.add_topic(INT32)
        bag.add_topic(replace(INT32, name=NAMES[1], offered_qos=()))
        for i in range(count):
            bag.write(INT32.name, int32(i), log_ns=2000 + i, publish_ns=1000 + i, sequence=i + 1)


def _metadata(folder: Path) -> dict[str, Any]:
    whole: dict[str, dict[str, Any]] = yaml.safe_load((folder / "metadata.yaml").read_text())
    assert list(whole) == ["rosbag2_bagfile_information"]
    return whole["rosbag2_bagfile_information"]


def test_metadata_is_that_of_another_writer_of_version_9(tmp_path: Path) -> None:
    _write(tmp_path / "ours", 5)
    with Writer(tmp_path / "theirs", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        writer.set_custom_data("seed", "7")
        made = [writer.add_connection(name, INT32.type, typestore=STORE) for name in NAMES]
        for i in range(5):
            writer.write(made[0], 2000 + i, int32(i))
    ours, theirs = (_metadata(tmp_path / name) for name in ("ours", "theirs"))
    first, second = (one["topic_metadata"] for one in ours["topics_with_message_count"])
    infinite = {"sec": 9223372036, "nsec": 854775807}
    known = {"history": "unknown", "depth": 0, "liveliness": "automatic", "deadline": infinite,
             "lifespan": infinite, "liveliness_lease_duration": infinite,
             "avoid_ros_namespace_conventions": False}  # fmt: skip
    assert first["offered_qos_profiles"] == [
        {**known, "reliability": "reliable", "durability": "volatile"},
        {**known, "reliability": "best_effort", "durability": "transient_local"},
    ]
    assert second["offered_qos_profiles"] == first.pop("offered_qos_profiles")[2:] == []
    del theirs["topics_with_message_count"][0]["topic_metadata"]["offered_qos_profiles"]
    assert (theirs.pop("ros_distro"), ours.pop("ros_distro")) == ("rosbags", "jazzy")
    assert ours == yaml.safe_load(yaml.safe_dump(theirs).replace("theirs.mcap", "ours_0.mcap"))
    files = sorted(path.name for path in (tmp_path / "ours").iterdir())
    assert files == ["metadata.yaml", "ours_0.mcap"]


def test_mcap_sees_the_profile_the_channels_and_the_metadata(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    _write(folder, 20_000)
    with (folder / "run_0.mcap").open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
        assert summary is not None
        (channel,) = summary.channels.values()
        (schema,) = summary.schemas.values()
        assert (schema.encoding, channel.message_encoding) == ("ros2msg", "cdr")
        metadata = _metadata(folder)
        told = metadata["topics_with_message_count"][0]["topic_metadata"]["offered_qos_profiles"]
        assert yaml.safe_load(channel.metadata["offered_qos_profiles"]) == told
        at_open, at_close = (record.metadata for record in reader.iter_metadata())
        assert yaml.safe_load(at_close["serialized_metadata"]) == metadata
        assert yaml.safe_load(at_open["serialized_metadata"])["message_count"] == 0
        _, _, message = next(iter(reader.iter_messages()))
        assert (message.log_time, message.publish_time, message.sequence) == (2000, 1000, 1)
        stream.seek(0)
        chunks = [r for r in StreamReader(stream, emit_chunks=True).records if isinstance(r, Chunk)]
    assert len(chunks) > 5
    assert max(chunk.uncompressed_size for chunk in chunks) <= 64 * 1024


def test_an_empty_bag_is_a_bag(tmp_path: Path) -> None:
    BagWriter(tmp_path / "run").close()
    with Reader(tmp_path / "run") as bag:
        assert bag.message_count == 0
        assert list(bag.messages()) == []
    with (tmp_path / "run" / "run_0.mcap").open("rb") as stream:
        assert list(make_reader(stream).iter_messages()) == []
    assert _metadata(tmp_path / "run")["starting_time"] == {"nanoseconds_since_epoch": 0}


def test_a_bag_that_cannot_be_made_leaves_nothing(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(BagError, match=r"file exists already; name another"):
        BagWriter(tmp_path / "file")
    with pytest.raises(BagError, match=r"cannot create the bag .*file/deep/run: Not a directory"):
        BagWriter(tmp_path / "file" / "deep" / "run")
    # The folder can be made with this name, its file cannot: that name is too long.
    with pytest.raises(BagError, match="File name too long"):
        BagWriter(tmp_path / "new" / ("x" * 250))
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_misuse_is_told(tmp_path: Path) -> None:
    bag = BagWriter(tmp_path / "run")
    bag.add_topic(INT32)
    with pytest.raises(BagError, match="add it once"):
        bag.add_topic(INT32)
    with pytest.raises(BagError, match="/other is not in the bag"):
        bag.write("/other", b"", log_ns=0, publish_ns=0)
    bag.close()
    with pytest.raises(BagError, match="is closed"):
        bag.write(INT32.name, int32(1), log_ns=0, publish_ns=0)


def test_discard_removes_what_was_made(tmp_path: Path) -> None:
    bag = BagWriter(tmp_path / "some" / "where" / "run")
    bag.discard()
    assert bag.closed
    bag.close()  # of what is gone: nothing is written
    assert list(tmp_path.iterdir()) == []


def test_a_new_file_begins_exactly_when_the_old_one_is_full(tmp_path: Path) -> None:
    """Not for an empty file; at the first message that is the time later, not the next one."""
    with BagWriter(tmp_path / "run", max_duration_ns=10) as bag:
        bag.add_topic(INT32)
        bag.split()
        assert (len(bag.files), bag.size) == (1, (tmp_path / "run" / "run_0.mcap").stat().st_size)
        for stamp in (0, 9, 10, 19, 20):
            bag.write(INT32.name, int32(stamp), log_ns=stamp, publish_ns=stamp)
        assert len(bag.files) == 3
        bag.flush()
        files = sorted((tmp_path / "run").glob("*.mcap"))
        assert bag.size == sum(file.stat().st_size for file in files)
    told = _metadata(tmp_path / "run")["files"]
    assert [(one["message_count"], one["duration"]["nanoseconds"]) for one in told] == [
        (2, 9),
        (2, 9),
        (1, 0),
    ]


def test_one_clock_decides_when_a_new_file_begins(tmp_path: Path) -> None:
    """Times of two clocks, one of them since the start of the machine, made 251 files of 500."""
    with BagWriter(tmp_path / "two", max_duration_ns=SECOND, sync=False) as bag:
        bag.add_topic(STEPS)
        for number in range(500):
            ns = number * SECOND // 100 + (START if number % 2 else 0)
            bag.write(STEPS.name, int32(number), log_ns=ns, publish_ns=ns)
        assert len(bag.files) == 1 + 5  # the second clock takes over, and runs for 5 s
    with BagWriter(tmp_path / "back", max_duration_ns=SECOND, sync=False) as bag:
        bag.add_topic(STEPS)
        for number in range(300):
            ns = START + number * SECOND // 100 - (100 * SECOND if number >= 150 else 0)
            bag.write(STEPS.name, int32(number), log_ns=ns, publish_ns=ns)
        assert len(bag.files) == 2  # the clock was set back after 1.5 s
