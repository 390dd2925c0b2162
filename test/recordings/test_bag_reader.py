# SPDX-License-Identifier: Apache-2.0
"""Reading bags: of ours, of rosbag2 in all its shapes, of strangers; and bags that are broken."""

import os
import random
import re
import struct
from dataclasses import replace
from pathlib import Path

import pytest
import yaml
import zstandard
from bags import (
    EVENTS,
    JOINTS,
    SECOND,
    SILENT,
    START,
    STEPS,
    expected,
    foreign,
    int32,
    record,
    records_of,
    samples,
)
from child import python
from mcap.opcode import Opcode
from mcap.writer import CompressionType, IndexType
from rosbags.rosbag2 import Reader

from stickslip_ros.cli.main import main
from stickslip_ros.recordings import (
    BagError,
    BagReader,
    BagWriter,
    OfferedQos,
    open_bag,
    recover,
    statuses,
)
from stickslip_ros.recordings.metadata import StoredMetadata


def read(bag: BagReader) -> list[tuple[str, int, bytes]]:
    return [(message.topic, message.log_ns, message.data) for message in bag.messages()]


@pytest.mark.parametrize("compression", ["none", "lz4", "zstd"])
@pytest.mark.parametrize("files", [1, 4])
def test_what_was_written_is_read(tmp_path: Path, compression: str, files: int) -> None:
    folder = tmp_path / "run"
    length = SECOND // 4 if files > 1 else 0
    written = record(folder, compression=compression, max_duration_ns=length)
    with open_bag(folder) as bag:
        assert read(bag) == expected(written)
        silent = replace(SILENT, schema="")  # schemas come with messages
        assert bag.topics == {topic.name: topic for topic in (STEPS, JOINTS, EVENTS, silent)}
        assert bag.counts[JOINTS.name] == sum(topic is JOINTS for topic, _, _ in written)
        assert bag.counts[SILENT.name] == 0
        assert bag.message_count == len(written)
        assert (bag.start_ns, bag.end_ns) == (written[0][1], written[-1][1])
        assert bag.custom_data == {"seed": "7"}
        assert bag.metadata.ros_distro == "jazzy"
        assert bag.compressions == ["" if compression == "none" else compression]
        assert len(bag.files) == files
        first = next(bag.messages())
        assert (first.publish_ns, first.sequence) == (START - 5, 1)


def test_topics_and_times_can_be_chosen(tmp_path: Path) -> None:
    written = record(tmp_path / "run", max_duration_ns=SECOND // 4)
    start, end = START + SECOND // 10, START + SECOND // 2
    with open_bag(tmp_path / "run") as bag:
        assert len(bag.files) == 4
        found = list(bag.messages([STEPS.name, EVENTS.name], start, end))
        assert [(m.topic, m.log_ns) for m in found] == [
            (topic.name, ns)
            for topic, ns, _ in written
            if topic in (STEPS, EVENTS) and start <= ns < end
        ]
        assert found[0].log_ns == start  # an event, at the first time to take
        assert list(bag.messages([])) == []
        assert list(bag.messages([SILENT.name])) == []
        with pytest.raises(BagError, match=r"no topic /other; it has /axis/command/jog, /axis"):
            bag.messages(["/other"])


def test_messages_come_in_order_of_time_over_chunks_and_files(tmp_path: Path) -> None:
    times = list(range(3000))
    # Neighbours change places, and some are late by a whole file.
    mixed = random.Random(1)
    late = sorted(times, key=lambda t: t + mixed.choice([0, 5, 40, 700]))
    assert late != times
    with BagWriter(tmp_path / "run", max_bytes=49_152) as writer:
        writer.add_topic(STEPS)
        for ns in late:
            writer.write(STEPS.name, int32(ns), log_ns=ns, publish_ns=0)
            if ns % 100 == 0:
                writer.flush()
    with open_bag(tmp_path / "run") as bag:
        assert len(bag.files) == 4
        assert [m.log_ns for m in bag.messages()] == times
        assert (bag.start_ns, bag.end_ns) == (0, 2999)
    with Reader(tmp_path / "run") as reader:
        assert (reader.start_time, reader.end_time) == (0, 3000)


def test_messages_outside_of_chunks_come_in_order_of_time(tmp_path: Path) -> None:
    """A run of them covers from the earliest to the latest, wherever these stand in it."""
    written = [(STEPS, ns, int32(ns)) for ns in (50, 90, 30, 40)]
    foreign(tmp_path / "mixed.mcap", written, use_chunking=False)
    with open_bag(tmp_path / "mixed.mcap") as bag:
        assert (bag.start_ns, bag.end_ns) == (30, 90)
        assert [message.log_ns for message in bag.messages()] == [30, 40, 50, 90]


def test_messages_of_one_time_keep_their_order(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "run") as writer:
        writer.add_topic(STEPS)
        for i in range(50):
            writer.write(STEPS.name, int32(i), log_ns=7, publish_ns=0)
            if i % 9 == 0:
                writer.flush()
    with open_bag(tmp_path / "run") as bag:
        assert [m.data for m in bag.messages()] == [int32(i) for i in range(50)]


def test_without_metadata_yaml_the_file_tells_all(tmp_path: Path) -> None:
    written = record(tmp_path / "run", max_bytes=60_000)
    (tmp_path / "run" / "metadata.yaml").unlink()
    with open_bag(tmp_path / "run") as bag:
        assert read(bag) == expected(written)
        assert bag.custom_data == {"seed": "7"}
        assert bag.topics[SILENT.name].offered_qos == SILENT.offered_qos
    with open_bag(tmp_path / "run" / "run_0.mcap") as file:
        assert read(file) == expected(written)[: file.message_count]
        assert 0 < file.message_count < len(written)


def test_files_come_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    """Not of their names, where 10 comes before 2."""
    record(tmp_path / "run", 120, max_duration_ns=SECOND // 100)
    (tmp_path / "run" / "metadata.yaml").unlink()
    for folder in (tmp_path / "run", recover(tmp_path / "run").folder):
        with open_bag(folder) as bag:
            assert [file.start_ns for file in bag.files] == [
                START + number * SECOND // 100 for number in range(12)
            ]


@pytest.mark.parametrize(
    "options",
    [
        {"compression": CompressionType.ZSTD, "chunk_size": 4096},
        {"use_chunking": False},  # as `ros2 bag record --storage-preset-profile fastwrite`
        {"index_types": IndexType.NONE, "chunk_size": 4096},
        {"use_statistics": False},
        {"repeat_channels": False, "repeat_schemas": False},
        {"use_summary_offsets": False, "enable_crcs": False},
        {
            "use_statistics": False,
            "repeat_channels": False,
            "repeat_schemas": False,
            "use_summary_offsets": False,
            "index_types": IndexType.NONE,
        },
    ],
    ids=lambda options: "-".join(options),
)
def test_files_of_others_are_read(tmp_path: Path, options: dict[str, object]) -> None:
    written = list(samples(500))
    foreign(tmp_path / "other.mcap", written, **options)
    with open_bag(tmp_path / "other.mcap") as bag:
        assert read(bag) == expected(written)
        assert sum(bag.counts.values()) == len(written)
        assert bag.topics[JOINTS.name].type == JOINTS.type
        assert (bag.start_ns, bag.end_ns) == (written[0][1], written[-1][1])
        assert (bag.libraries, bag.custom_data) == (["another"], {})


def _old_qos(reliability: int) -> str:
    never = {"sec": 9223372036, "nsec": 854775807}
    profile = {"history": 3, "depth": 0, "reliability": reliability, "durability": 2}
    profile |= {"deadline": never, "lifespan": never, "liveliness": 1}  # type: ignore[dict-item]
    profile |= {"liveliness_lease_duration": never, "avoid_ros_namespace_conventions": False}  # type: ignore[dict-item]
    return str(yaml.safe_dump([profile]))


def test_the_metadata_of_older_distributions_is_read(tmp_path: Path) -> None:
    """Version 5, of Humble: QoS as text, with numbers; custom data that is ~, no hashes."""
    written = record(tmp_path / "run", 40)
    file = tmp_path / "run" / "metadata.yaml"
    whole = yaml.safe_load(file.read_text())
    inner = whole["rosbag2_bagfile_information"]
    inner["version"] = 5
    for entry in inner["topics_with_message_count"]:
        entry["topic_metadata"]["offered_qos_profiles"] = _old_qos(2)
        del entry["topic_metadata"]["type_description_hash"]
    inner["custom_data"] = None
    for key in ("ros_distro", "files"):
        del inner[key]
    file.write_text(yaml.safe_dump(whole))
    with open_bag(tmp_path / "run") as bag:
        assert read(bag) == expected(written)
        assert (bag.metadata.version, bag.custom_data) == (5, {})
        assert bag.topics[SILENT.name].offered_qos == (OfferedQos(reliability="best_effort"),)


def test_statuses_come_with_their_values(tmp_path: Path) -> None:
    record(tmp_path / "run", 100)
    with open_bag(tmp_path / "run") as bag:
        first, *others = statuses(bag, EVENTS.name)
        assert (first.name, first.level, first.stamp_ns) == ("/axis: event", 0, START)
        assert first.values["event"] == "start" and first.values["preload"] == "1.0"
        assert [status.values["time (s)"] for status in others] == ["0.02", "0.04", "0.06", "0.08"]
        with pytest.raises(BagError, match="is std_msgs/msg/Int32; it has to be diagnostic_msgs"):
            list(statuses(bag, STEPS.name))
        with pytest.raises(BagError, match="is not there"):
            list(statuses(bag, "/other"))


# What is broken. Each ends in one error that names the file and what to do.


def refused(path: Path, text: str) -> None:
    """The bag cannot be opened, or not be read to its end, and the error says so."""
    with pytest.raises(BagError, match=text) as error, open_bag(path) as bag:
        for _ in bag.messages():
            pass
    assert "\n" not in str(error.value)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """The only storage file of a good bag."""
    record(tmp_path / "run", 200)
    return tmp_path / "run" / "run_0.mcap"


def _offset_of(file: Path, kind: Opcode) -> int:
    return records_of(file.read_bytes(), kind)[0]


def _patch(file: Path, at: int, value: bytes) -> None:
    data = bytearray(file.read_bytes())
    data[at : at + len(value)] = value
    file.write_bytes(data)


def _chunk(size: int, compression: bytes, data: bytes) -> bytes:
    """A chunk that says it is so large, without a checksum."""
    body = struct.pack("<QQQII", 0, 2**63, size, 0, len(compression)) + compression
    body += struct.pack("<Q", len(data)) + data
    return struct.pack("<BQ", Opcode.CHUNK, len(body)) + body


def _file_of(file: Path, *records: bytes) -> None:
    """A file without an index: header, records, end."""
    magic = b"\x89MCAP0\r\n"
    head = struct.pack("<BQII", Opcode.HEADER, 8, 0, 0)
    end = struct.pack("<BQI", Opcode.DATA_END, 4, 0) + struct.pack(
        "<BQQQI", Opcode.FOOTER, 20, 0, 0, 0
    )
    file.write_bytes(magic + head + b"".join(records) + end + magic)


def test_a_record_longer_than_its_file_is_told_with_what_is_left(tmp_path: Path) -> None:
    file = tmp_path / "long.mcap"
    record = struct.pack("<BQ", Opcode.METADATA, 1_000_000) + bytes(100)
    _file_of(file, record)
    left = 100 + 9 + 4  # its body and the end of the data, up to the footer
    refused(file, f"says it is 1000000 bytes long, but {left} are left")
    _file_of(file, bytes(1000))  # a disk that lost its power leaves gigabytes of them
    refused(file, "there is no record at byte")


def _bombs() -> dict[str, bytes]:
    import lz4.frame

    zeros = bytes(2**20)
    told = zstandard.ZstdCompressor(level=1).compressobj(size=2**28)
    silent = zstandard.ZstdCompressor(level=1).compressobj()
    packed_told, packed_silent = (
        b"".join([*(each.compress(zeros) for _ in range(256)), each.flush()])
        for each in (told, silent)
    )
    with lz4.frame.LZ4FrameCompressor() as press:
        packed_lz4 = press.begin() + b"".join(press.compress(zeros) for _ in range(256))
        packed_lz4 += press.flush()
    return {
        "zstd that tells its size": _chunk(1000, b"zstd", packed_told),
        "zstd that does not": _chunk(1000, b"zstd", packed_silent),
        "zstd, large": _chunk(2**28, b"zstd", packed_silent),
        "zstd, as large as is taken": _chunk(2**26, b"zstd", packed_silent),
        "lz4": _chunk(1000, b"lz4", packed_lz4),
        "lz4, large": _chunk(2**28, b"lz4", packed_lz4),
        "a size without data": _chunk(2**63, b"", b""),
        "unknown": _chunk(1000, b"bz2", packed_lz4),
    }


# Not of getrusage, where a child begins with the memory of its parent.
MEASURE = """
import re, sys
from stickslip_ros.recordings import BagError, open_bag
def peak():
    return int(re.search(r"VmHWM:\\s+(\\d+)", open("/proc/self/status").read())[1])
before = peak()
for path in sys.argv[1:]:
    try:
        with open_bag(path) as bag:
            count = sum(1 for _ in bag.messages())
        print("read")
    except BagError as error:
        print(error)
print(peak() - before)
"""


def memory_to_read(*paths: Path) -> tuple[float, list[str]]:
    """Return the most MB that reading each of some bags takes in a process, and how each ended."""
    child = python("-c", MEASURE, *map(str, paths))
    *said, kilobytes = child.stdout.splitlines()
    return int(kilobytes) / 1000, said


def test_a_chunk_that_would_fill_the_memory_is_refused(tmp_path: Path) -> None:
    """One process reads all of them, and never takes more than the largest may."""
    for name, chunk in _bombs().items():
        _file_of(tmp_path / f"{name}.mcap", chunk)
    files = sorted(tmp_path.iterdir())
    megabytes, said = memory_to_read(*files)
    assert megabytes < 200
    for file, text in zip(files, said, strict=True):
        assert f"{file} is damaged" in text or f"{file} unpacks to more than" in text
    # In packed chunks, a megabyte of schema takes a few bytes.
    chunks = []
    for number in range(1, 201):
        schema = b"# " + bytes(900_000)
        body = struct.pack("<HIII", number, 0, 0, len(schema)) + schema
        packed = zstandard.compress(struct.pack("<BQ", Opcode.SCHEMA, len(body)) + body)
        chunks.append(_chunk(9 + len(body), b"zstd", packed))
    _file_of(tmp_path / "bomb.mcap", *chunks)
    megabytes, (refusal,) = memory_to_read(tmp_path / "bomb.mcap")
    assert "bytes of schemas" in refusal
    assert megabytes < 100


def test_a_file_that_would_fill_the_disk_is_refused(tmp_path: Path) -> None:
    press = zstandard.ZstdCompressor().compressobj()
    zeros = bytes(2**20)
    packed = b"".join([*(press.compress(zeros) for _ in range(256)), press.flush()])
    (tmp_path / "bomb.mcap.zstd").write_bytes(packed)
    refused(tmp_path, "unpacks to more than 300 times its size")
    (tmp_path / "bomb.mcap.zstd").write_bytes(b"no zstd")
    refused(tmp_path, "its zstd data is broken")


def test_memory_does_not_grow_with_the_bag(tmp_path: Path) -> None:
    """Thirty times the messages, the same memory but for 250 bytes a chunk."""
    used = {}
    payload = bytes(30_000)
    for count in (100, 3_000):
        folder = tmp_path / f"run_{count}"
        with BagWriter(folder, compression="lz4") as writer:
            writer.add_topic(STEPS)
            for i in range(count):
                writer.write(STEPS.name, payload, log_ns=i, publish_ns=i)
        used[count], (said,) = memory_to_read(folder)
        assert said == "read"
    assert used[3_000] < used[100] + 3  # of 90


def test_chunks_that_cannot_be_sorted_in_memory_are_refused(tmp_path: Path) -> None:
    """Each chunk reaches over the whole time, so all would have to be open together."""
    with (tmp_path / "run.mcap").open("wb") as stream:
        from mcap.writer import Writer

        writer = Writer(stream, chunk_size=2**24, compression=CompressionType.LZ4)
        writer.start("ros2")
        channel = writer.register_channel("/a", "cdr", 0)
        payload = bytes(2**22)
        for _ in range(12):
            for ns in (1, 5, 6, 100):
                writer.add_message(channel, ns, payload, ns)
        writer.finish()
    refused(tmp_path, "too far out of order to be sorted in memory; sort them with `mcap sort`")


def test_an_index_that_lies_about_counts_is_refused(
    file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """9.2e18 messages of 24 kB; and one too many, which only reading brings to light."""
    at = _offset_of(file, Opcode.STATISTICS) + 9
    counts = struct.unpack_from("<QHIIIIQQI", file.read_bytes(), at)
    counted = at + struct.calcsize("<QHIIIIQQIH")
    good = file.read_bytes()
    for extra, words in (
        (2**63 - 300, "its index counts 9223372036854775708 messages; .* fit into its chunks"),
        (1, "201 messages are counted, 200 were found"),
    ):
        data = bytearray(good)
        (of_first,) = struct.unpack_from("<Q", data, counted)
        struct.pack_into("<Q", data, at, counts[0] + extra)
        struct.pack_into("<Q", data, counted, of_first + extra)
        file.write_bytes(data)
        _patch(file, _offset_of(file, Opcode.FOOTER) + 9 + 16, bytes(4))  # and no checksum
        refused(file, words)
    assert main(["bag", "info", str(file)]) == 0
    assert "messages     201" in capsys.readouterr().out


def test_chunks_are_bounded_in_sum(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A hundred chunks of 4 MB of zeros in 40 kB; each by itself is no larger than is allowed."""
    zeros = struct.pack("<BQ", 0x80, 2**22 - 9) + bytes(2**22 - 9)
    bomb = _chunk(len(zeros), b"zstd", zstandard.compress(zeros))
    file = tmp_path / "bomb.mcap"
    _file_of(file, *[bomb] * 100)
    words = "unpacks to more than 300 times its size; .* set STICKSLIP_UNPACK_FACTOR"
    refused(file, words)
    gone_through: list[int] = []
    with pytest.raises(BagError, match=words):
        recover(file, tmp_path / "new", gone_through.append)
    assert sum(gone_through) < file.stat().st_size / 4  # refused before it takes minutes
    assert not (tmp_path / "new").exists()
    monkeypatch.setenv("STICKSLIP_UNPACK_FACTOR", "1e6")
    with open_bag(file) as bag:
        assert list(bag.messages()) == []
    assert recover(file, tmp_path / "new").messages == 0


def test_a_bag_that_is_not_there_or_of_another_kind_is_refused(tmp_path: Path) -> None:
    refused(tmp_path / "gone", "there is no bag .*gone; check the name")
    refused(tmp_path, "there is no .mcap or .db3 file in")
    refused(tmp_path / ("x" * 300), "cannot read .*File name too long")
    (tmp_path / "run_0.db3").write_bytes(b"SQLite format 3")
    refused(tmp_path, "cannot be read: .*; .*`ros2 bag convert`")
    refused(tmp_path / "run_0.db3", "`ros2 bag convert")
    os.mkfifo(tmp_path / "pipe.mcap")
    refused(tmp_path / "pipe.mcap", "is not a file but a pipe")
    for name in ("metadata.yaml", "run_0.db3"):  # whichever is looked at, nobody waits for it
        folder = tmp_path / f"of {name}"
        folder.mkdir()
        os.mkfifo(folder / name)
        refused(folder, f"{name} is not a file but a pipe")
    (tmp_path / "text.mcap").write_text("hello")
    refused(tmp_path / "text.mcap", "does not begin as an MCAP file does")


# A list of a list of a list ..., each with two of the one before.
BILLION = "a0: &a0 [1]\n" + "".join(f"a{i}: &a{i} [*a{i - 1}, *a{i - 1}]\n" for i in range(1, 41))
GOOD = "rosbag2_bagfile_information:\n  version: 9\n  storage_identifier: mcap\n"


NONSENSE = (
    ("", "it has no rosbag2_bagfile_information"),
    ("a: [1", "not YAML"),
    ("- 1\n- 2\n", "it has no rosbag2_bagfile_information"),
    ("other: 1\n", "it has no rosbag2_bagfile_information"),
    ("rosbag2_bagfile_information: [1]\n", "has to be a mapping"),
    (GOOD.replace("9", "nine"), "version is 'nine'"),
    (GOOD.replace("9", "9" * 5000), "version is '999"),
    (GOOD + "  relative_file_paths: {a: b}\n", "relative_file_paths has to be a list"),
    (GOOD + "  relative_file_paths: [[a]]\n", "has to be a single value"),
    (GOOD + "  topics_with_message_count: [1]\n", "has to be a mapping"),
    (
        GOOD + "  topics_with_message_count: [{topic_metadata: {name: [a]}}]\n",
        "name has to be a single value",
    ),
    (GOOD + "  custom_data: {a: {b: c}}\n", "a has to be a single value"),
    (BILLION, "too long"),
    ("\udcff", "not what rosbag2 writes"),
    ("!!python/object/apply:os.getcwd []\n", "it has no rosbag2_bagfile_information"),
    (GOOD + "  relative_file_paths: [gone_0.mcap]\n", "lacks gone_0.mcap"),
    (GOOD + '  relative_file_paths: ["a\\0b", ..]\n', "lacks|is not a file"),
    (GOOD.replace("9", "10"), "version 10; the newest known is version 9"),
    (GOOD + "  compression_format: lz5\n  compression_mode: FILE\n", "compressed with 'lz5'"),
)


def test_metadata_that_makes_no_sense_is_refused(file: Path) -> None:
    yaml_file = file.with_name("metadata.yaml")
    for text, problem in NONSENSE:
        yaml_file.write_bytes(text.encode("utf-8", "surrogateescape"))
        refused(file.parent, problem)
    yaml_file.unlink()
    with open_bag(file.parent) as bag:  # the cure that the text names
        assert bag.message_count == 200
    for text, problem in (
        (GOOD + "  # " + "x" * 2_000_000, "is too long; its bag is read without it"),
        (GOOD.replace("mcap", "tape"), "says tape of its storage, but run_0.mcap is mcap"),
    ):
        yaml_file.write_text(text)
        with open_bag(file.parent) as bag:
            assert bag.message_count == 200 and problem in bag.warnings[0]
    file.unlink()
    refused(file.parent, "is stored as tape, .*`ros2 bag convert")


def test_a_record_of_metadata_that_makes_no_sense_is_refused(file: Path) -> None:
    file.with_name("metadata.yaml").unlink()
    data = file.read_bytes()
    at = data.rindex(b"storage_identifier: mcap")
    _patch(file, at, b"storage_identifier: [[[[")
    refused(file.parent, r"run_0.mcap is damaged: its metadata: not YAML")


def test_errors_name_the_file_of_a_split_bag(tmp_path: Path) -> None:
    record(tmp_path / "run", max_bytes=60_000)
    second = tmp_path / "run" / "run_1.mcap"
    _patch(second, _offset_of(second, Opcode.CHUNK) + 500, b"\xa5\x5a\xa5")
    with open_bag(tmp_path / "run") as bag:
        messages = bag.messages()
        assert next(messages).log_ns == START
        with pytest.raises(BagError, match=re.escape(str(second))):
            list(messages)


def test_times_of_zero_are_times(tmp_path: Path) -> None:
    """A clock of a simulation begins there; without an index each message is looked at."""
    written = [(STEPS, 0, int32(1)), (STEPS, 0, int32(2))]
    options = {"index_types": IndexType.NONE, "use_statistics": False, "use_summary_offsets": False}
    foreign(tmp_path / "zero.mcap", written, **options)
    with open_bag(tmp_path / "zero.mcap") as bag:
        assert (bag.start_ns, bag.end_ns, bag.message_count) == (0, 0, 2)
        assert [message.data for message in bag.messages()] == [int32(1), int32(2)]


def test_metadata_fill_in_only_what_a_file_does_not_say() -> None:
    stored = replace(STEPS, type_hash="RIHS01_told", offered_qos=(OfferedQos(depth=7),))
    bare = replace(STEPS, type_hash="", offered_qos=())
    metadata = StoredMetadata(topics={stored.name: stored})
    assert metadata.completed(bare) == stored
    assert metadata.completed(STEPS) == STEPS
    assert metadata.completed(SILENT) == SILENT
