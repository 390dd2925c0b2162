# SPDX-License-Identifier: Apache-2.0
"""Bags of sqlite3 and of ROS 1, written by ``rosbags``: they read as ours do."""

import re
import sqlite3
import subprocess
import sys
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
import yaml
from bags import EVENTS, JOINTS, SECOND, START, STEPS, STORE, Sample, by_rosbags, contents, expected
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.enums import CompressionFormat, CompressionMode
from rosbags.typesys import Stores, get_typestore

from stickslip_ros.recordings import BagError, OfferedQos, decoder_for, open_bag, recover, statuses
from stickslip_ros.recordings.schemas import nanoseconds


def write_sqlite(folder: Path, version: Literal[8, 9], count: int = 500) -> list[Sample]:
    return by_rosbags(Writer(folder, version=version, storage_plugin=StoragePlugin.SQLITE3), count)


@pytest.mark.parametrize("version", [8, 9])
@pytest.mark.parametrize("what", ["folder", "without metadata.yaml", "file"])
def test_a_bag_of_sqlite3_is_read(tmp_path: Path, version: Literal[8, 9], what: str) -> None:
    written = write_sqlite(tmp_path / "run", version)
    path = tmp_path / "run"
    if what == "file":
        path = next(path.glob("*.db3"))
    elif what == "without metadata.yaml":
        (path / "metadata.yaml").unlink()
    with open_bag(path) as bag:
        assert contents(path) == expected(written)
        assert bag.message_count == len(written)
        assert (bag.start_ns, bag.end_ns) == (START, written[-1][1])
        joints = bag.topics[JOINTS.name]
        assert (joints.type, joints.type_hash) == (JOINTS.type, JOINTS.type_hash)
        first, *_ = statuses(bag, EVENTS.name)
        assert first.values["preload"] == "1.0"
        some = list(bag.messages([STEPS.name], START + SECOND // 10, START + SECOND // 5))
        assert [m.log_ns for m in some] == [
            ns for t, ns, _ in written if t is STEPS and SECOND // 10 <= ns - START < SECOND // 5
        ]
        assert decoder_for(bag.topics[STEPS.name])(some[0].data).data == 107
        with pytest.raises(BagError, match="has no topic /other; it has"):
            bag.messages(["/other"])


def test_a_file_without_messages_has_no_times(tmp_path: Path) -> None:
    """The first and the last time of all files is that of those with messages."""
    written = write_sqlite(tmp_path / "run", 9)
    (file,) = (tmp_path / "run").glob("*.db3")
    more = file.with_name("zzz.db3")
    more.write_bytes(file.read_bytes())
    with sqlite3.connect(more) as database:
        database.execute("DELETE FROM messages")
    metadata = tmp_path / "run" / "metadata.yaml"
    known = yaml.safe_load(metadata.read_text())
    known["rosbag2_bagfile_information"]["relative_file_paths"].append(more.name)
    metadata.write_text(yaml.safe_dump(known))
    with open_bag(tmp_path / "run") as bag:
        assert (bag.start_ns, bag.end_ns) == (START, written[-1][1])
        ends = [(each.messages, each.start_ns, each.end_ns) for each in bag.files]
        assert ends == [(500, START, written[-1][1]), (0, 0, 0)]


def reindexed(folder: Path) -> None:
    """Leave metadata.yaml as `ros2 bag reindex` does: no QoS, no hashes, the count it found."""
    file = folder / "metadata.yaml"
    known = yaml.safe_load(file.read_text())
    for entry in known["rosbag2_bagfile_information"]["topics_with_message_count"]:
        entry["topic_metadata"]["offered_qos_profiles"] = ""
        entry["topic_metadata"]["type_description_hash"] = ""
    file.write_text(yaml.safe_dump(known))


def test_a_bag_that_was_indexed_anew_is_read(tmp_path: Path) -> None:
    """Its metadata offers another QoS than the file, by which rosbags finds no topic again."""
    written = write_sqlite(tmp_path / "run", 8)
    reindexed(tmp_path / "run")
    with open_bag(tmp_path / "run") as bag:
        assert len(list(bag.messages())) == bag.message_count == len(written)
        assert bag.warnings == []


def test_counts_are_held_against_the_metadata(tmp_path: Path) -> None:
    write_sqlite(tmp_path / "run", 9)
    (file,) = (tmp_path / "run").glob("*.db3")
    with sqlite3.connect(file) as database:
        database.execute("DELETE FROM messages WHERE id > 100")
    with open_bag(tmp_path / "run") as bag:
        assert len(list(bag.messages())) == 100
        assert "counts 500 messages, 100 were found; `ros2 bag reindex`" in bag.warnings[0]
    with sqlite3.connect(file) as database:
        database.execute("UPDATE messages SET timestamp = -5 WHERE id = 3")
    with open_bag(tmp_path / "run") as bag:
        assert len(list(bag.messages([STEPS.name]))) == bag.counts[STEPS.name]


def test_a_bag_of_ros_1_is_read(tmp_path: Path) -> None:
    store = get_typestore(Stores.ROS1_NOETIC)
    time, header = (
        store.types[name] for name in ("builtin_interfaces/msg/Time", "std_msgs/msg/Header")
    )
    with Writer1(tmp_path / "old.bag") as writer:
        connection = writer.add_connection("/joint_states", JOINTS.type, typestore=store)
        for number in range(20):
            ns = START + number * SECOND
            message = store.types[JOINTS.type](
                header=header(seq=number, stamp=time(ns // SECOND, 5), frame_id=""),
                name=["a_slider"],
                position=np.array([1e-9 * number]),
                velocity=np.zeros(0),
                effort=np.zeros(0),
            )
            writer.write(connection, ns, store.serialize_ros1(message, JOINTS.type))
    with open_bag(tmp_path / "old.bag") as bag:
        decode = decoder_for(bag.topics["/joint_states"])
        joints = bag.topics["/joint_states"]
        assert (joints.type_hash, joints.offered_qos) == ("", (OfferedQos(),))
        states = [decode(message.data) for message in bag.messages()]
        assert bag.message_count == 20
        assert [state.position[0] for state in states] == [1e-9 * number for number in range(20)]
        assert nanoseconds(states[3].header.stamp) == START + 3 * SECOND + 5


def test_damage_and_packing_end_in_one_error(tmp_path: Path) -> None:
    write_sqlite(tmp_path / "run", 9)
    file = next((tmp_path / "run").glob("*.db3"))
    whole = file.read_bytes()
    for broken in (b"", whole[:5000], whole[: len(whole) // 2], b"\xff" * 9000):
        file.write_bytes(broken)
        with pytest.raises(BagError) as refused, open_bag(tmp_path / "run") as bag:
            list(bag.messages())
        assert "\n" not in str(refused.value)
    (tmp_path / "old.bag").write_bytes(b"#ROSBAG V2.0\n" + bytes(100))
    with pytest.raises(BagError, match=r"old\.bag cannot be read"):
        open_bag(tmp_path / "old.bag")
    packed = Writer(tmp_path / "packed", version=9, storage_plugin=StoragePlugin.SQLITE3)
    packed.set_compression(CompressionMode.MESSAGE, CompressionFormat.ZSTD)
    with packed:
        packed.add_connection(STEPS.name, STEPS.type, typestore=STORE)
    with pytest.raises(
        BagError, match=r"compressed with .zstd., but only zstd is supported, and only of MCAP"
    ):
        open_bag(tmp_path / "packed")


def test_a_table_that_is_missing_is_told(tmp_path: Path) -> None:
    with sqlite3.connect(tmp_path / "run.db3") as database:
        database.execute("CREATE TABLE other (id INTEGER)")
    with pytest.raises(BagError, match=r"run\.db3 cannot be read"):
        open_bag(tmp_path / "run.db3")


def test_without_the_library_the_cure_is_told(tmp_path: Path) -> None:
    (tmp_path / "run.db3").touch()
    program = (
        "import sys; sys.modules['rosbags.highlevel'] = None\n"
        "from stickslip_ros.recordings import open_bag\n"
        f"open_bag({str(tmp_path / 'run.db3')!r})"
    )
    child = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert "pip install 'stickslip_ros[formats]'" in child.stderr.splitlines()[-1]


@pytest.mark.parametrize("what", ["sqlite3", "mcap"])
@pytest.mark.parametrize("end", [".mcap", ".db3"])
def test_a_bag_is_read_by_what_its_files_are(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, what: str, end: str
) -> None:
    """Whatever metadata.yaml, and the names of the files, say of the storage."""
    plugin = StoragePlugin.SQLITE3 if what == "sqlite3" else StoragePlugin.MCAP
    written = by_rosbags(Writer(tmp_path / "run", version=9, storage_plugin=plugin), 100)
    (file,) = (tmp_path / "run").glob("run*")
    file.rename(renamed := file.with_suffix(end))
    yaml_file = tmp_path / "run" / "metadata.yaml"
    text = yaml_file.read_text().replace(file.name, renamed.name)
    wrong = "mcap" if what == "sqlite3" else "sqlite3"
    yaml_file.write_text(re.sub("storage_identifier: .*", f"storage_identifier: {wrong}", text))
    with open_bag(tmp_path / "run") as bag:
        assert [one.data for one in bag.messages()] == [data for _, _, data in written]
        (warning,) = bag.warnings
        assert caplog.messages == [warning]
    assert f"says {wrong} of its storage, but {renamed.name} is {what}" in warning
    if what == "mcap":
        done = recover(tmp_path / "run")
        assert done.messages == 100 and "says sqlite3 of its storage" in done.findings[0]
        return
    with pytest.raises(BagError, match="is a SQLite file"):
        recover(tmp_path / "run")
