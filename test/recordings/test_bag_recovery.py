# SPDX-License-Identifier: Apache-2.0
"""Recovery: from killed recorders and damaged files, everything that is whole and nothing else."""

import json
import os
import signal
import struct
import sys
import zlib
from pathlib import Path

import killed
import pytest
from bags import (
    EVENTS,
    SECOND,
    SILENT,
    START,
    STEPS,
    Sample,
    contents,
    expected,
    foreign,
    int32,
    record,
    records_of,
    samples,
    topic,
)
from child import python
from mcap.opcode import Opcode
from rosbags.rosbag2 import Reader

from stickslip_ros.base.files import WriteError
from stickslip_ros.recordings import (
    BagError,
    BagWriter,
    TopicDescription,
    open_bag,
    recover,
)
from stickslip_ros.recordings.recovery import Recovered

KILLS = os.environ.get("STICKSLIP_KILLS", "2")


def files_of(folder: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in folder.iterdir()}


def four_chunks(folder: Path, **options: str) -> tuple[list[Sample], Path, bytearray]:
    """Record a bag of four chunks; return what is in it, its file, and the bytes of that."""
    written = record(folder / "run", 400, flush_every=100, **options)
    file = folder / "run" / "run_0.mcap"
    return written, file, bytearray(file.read_bytes())


def recover_from(file: Path, data: bytes | bytearray) -> Recovered:
    """Recover a bag whose file has these bytes."""
    file.write_bytes(data)
    return recover(file.parent)


@pytest.mark.timeout(300 + 60 * int(KILLS))  # a disk that is busy with other things
@pytest.mark.parametrize(("compression", "hertz"), [("none", 1000), ("zstd", 1000), ("zstd", 4000)])
def test_a_killed_recorder_loses_a_second_at_most(
    tmp_path: Path, compression: str, hertz: int
) -> None:
    """Killed anywhere: in the middle of a message, of a write, of a change of files."""
    child = python(killed.__file__, str(tmp_path), compression, KILLS, str(hertz))
    assert child.returncode == 0, child.stderr
    lost = []
    for number, given in enumerate(json.loads(child.stdout)):
        bag = tmp_path / f"run_{number}"
        with pytest.raises(BagError, match="stickslip bag recover"):
            open_bag(bag)
        done = recover(bag)
        times = [ns for _, ns, _ in contents(done.folder)]
        step = SECOND // hertz
        assert times == [START + number * step for number in range(done.messages)]  # without a gap
        assert any("has no end" in finding for finding in done.findings)
        lost.append((given - done.messages) / hertz)
        with Reader(done.folder) as reader:
            assert reader.message_count == done.messages
    print("lost (s):", lost)
    assert max(lost) <= 1.0


@pytest.mark.parametrize("compression", ["none", "lz4", "zstd"])
def test_what_is_whole_is_kept_as_it_was(tmp_path: Path, compression: str) -> None:
    written = record(tmp_path / "run", compression=compression, max_duration_ns=SECOND // 4)
    before = files_of(tmp_path / "run")
    done = recover(tmp_path / "run")
    assert done == Recovered(tmp_path / "run_recovered", len(written), 0, 0, ())
    assert files_of(tmp_path / "run") == before
    assert contents(done.folder) == expected(written)
    with open_bag(tmp_path / "run") as old, open_bag(done.folder) as new:
        assert (new.topics, new.counts, new.files[1].messages) == (old.topics, old.counts, 250)
        assert (new.custom_data, new.metadata.ros_distro) == ({"seed": "7"}, "jazzy")
        assert new.compressions == old.compressions
        assert [m.sequence for m in new.messages()] == list(range(1, len(written) + 1))
    with Reader(done.folder) as reader:
        assert reader.message_count == len(written)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run", "run_recovered"]


@pytest.mark.parametrize("compression", ["none", "lz4", "zstd"])
def test_every_cut_keeps_the_whole_chunks_before_it(tmp_path: Path, compression: str) -> None:
    written = record(tmp_path / "run", 300, flush_every=100, compression=compression)
    (tmp_path / "run" / "metadata.yaml").unlink()
    file = tmp_path / "run" / "run_0.mcap"
    data = file.read_bytes()
    ends = [
        at + 9 + int.from_bytes(data[at + 1 : at + 9], "little")
        for at in records_of(data, Opcode.CHUNK)
    ]
    assert len(ends) == 3
    for left in [*range(0, len(data), 7919), ends[1] - 1, ends[1], len(data) - 9, len(data) - 1]:
        file.write_bytes(data[:left])
        done = recover(tmp_path / "run", tmp_path / f"cut_{left}")
        assert done.messages == 100 * sum(end <= left for end in ends)
        assert contents(done.folder) == expected(written)[: done.messages]


def _flip(data: bytearray, at: int) -> None:
    data[at] ^= 0x55


def test_metadata_comes_from_the_file_when_its_own_file_is_gone(tmp_path: Path) -> None:
    record(tmp_path / "run", 40)
    for text in (None, "a: [1"):
        yaml_file = tmp_path / "run" / "metadata.yaml"
        yaml_file.unlink() if text is None else yaml_file.write_text(text)
        done = recover(tmp_path / "run", tmp_path / f"new_{text is None}")
        with open_bag(done.folder) as bag:
            assert bag.custom_data == {"seed": "7"}
            assert bag.topics[SILENT.name].offered_qos == SILENT.offered_qos
            assert bag.topics[EVENTS.name] == EVENTS


@pytest.mark.parametrize("chunks", [True, False])
def test_files_of_others_are_recovered(tmp_path: Path, chunks: bool) -> None:
    written = list(samples(300))
    file = tmp_path / "other.mcap"
    foreign(file, written, use_chunking=chunks, chunk_size=5000)
    whole_file = recover(file, tmp_path / "whole")
    assert (whole_file.unprotected, whole_file.findings) == (0 if chunks else len(written), ())
    data = file.read_bytes()[: file.stat().st_size // 2]
    file.write_bytes(data)
    done = recover(file)
    assert done.folder == tmp_path / "other_recovered"
    found = contents(done.folder)
    whole = sum(message in data for _, _, message in written)
    assert 50 < len(found) <= whole
    assert len(found) == whole or chunks  # but for those of the chunk that is cut
    assert found == expected(written)[: len(found)]


def test_nothing_is_left_behind_when_there_is_nothing_to_recover(tmp_path: Path) -> None:
    bag = tmp_path / "run"
    with pytest.raises(BagError, match="there is no bag"):
        recover(bag)
    bag.mkdir()
    with pytest.raises(BagError, match=r"there is no .mcap or .db3 file in"):
        recover(bag)
    (bag / "run_0.mcap").write_text("this is no recording at all")
    with pytest.raises(BagError, match="there is no part of a recording in"):
        recover(bag)
    with pytest.raises(WriteError, match=r"new: No such file or directory; make its folder first"):
        recover(bag, tmp_path / "gone" / "new")
    (tmp_path / "there").mkdir()
    with pytest.raises(WriteError, match="there: File exists; choose another name"):
        recover(bag, tmp_path / "there")
    (bag / "run_0.mcap").rename(bag / "run_0.db3")
    with pytest.raises(BagError, match=r"sqlite3 run_0\.db3 \.recover \| sqlite3 NEW\.db3"):
        recover(bag)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run", "there"]


def test_messages_of_a_topic_whose_name_no_checksum_protects_are_told(tmp_path: Path) -> None:
    """Of the first chunk only the records inside are left, with an error in the name of a topic."""
    written, file, data = four_chunks(tmp_path)
    index = records_of(data, Opcode.DATA_END)[0]
    del data[index:]
    at = records_of(data, Opcode.CHUNK)[0]
    data[at] = 0x80  # a private record as long as the head of the chunk
    data[at + 1 : at + 9] = (40).to_bytes(8, "little")
    name = data.index(EVENTS.name.encode())
    data[name + 1 : name + 2] = b"b"
    done = recover_from(file, data)
    renamed = f"/b{EVENTS.name[2:]}"
    kept = contents(done.folder)
    true_names = [(EVENTS.name if one[0] == renamed else one[0], *one[1:]) for one in kept]
    assert true_names == expected(written)
    assert done.unprotected == 400  # no chunk with a right checksum names a topic any more
    assert any("no checksum for 400 of these" in finding for finding in done.findings)


def test_a_compression_that_nobody_knows_costs_its_chunk_alone(tmp_path: Path) -> None:
    """The new bag is packed as the first chunk that is whole."""
    written, file, data = four_chunks(tmp_path, compression="zstd")
    at = data.index(b"zstd", records_of(data, Opcode.CHUNK)[0])
    data[at : at + 4] = b"bzip"
    done = recover_from(file, data)
    assert contents(done.folder) == expected(written)[100:]
    with open_bag(done.folder) as bag:
        assert bag.compressions == ["zstd"]


def test_a_cut_file_packed_as_a_whole_is_told(tmp_path: Path) -> None:
    """So small that it is a single block: nothing of it can be unpacked."""
    import zstandard

    foreign(tmp_path / "run.mcap", list(samples(50)))
    packed = zstandard.compress((tmp_path / "run.mcap").read_bytes())
    (tmp_path / "small.mcap.zstd").write_bytes(packed[:-20])
    done = recover(tmp_path / "small.mcap.zstd")
    assert done.messages == 0
    assert done.findings[0].startswith("small.mcap.zstd is cut: its zstd data ends early, 0 bytes")


@pytest.mark.parametrize("off", [-4, 1, 10, 300])
def test_a_message_of_a_wrong_length_is_not_kept(tmp_path: Path, off: int) -> None:
    """Outside of chunks: with a part of the next one behind it, it would still decode."""
    written = list(samples(200))
    file = tmp_path / "run.mcap"
    foreign(file, written, use_chunking=False)
    data = bytearray(file.read_bytes())
    at = records_of(data, Opcode.MESSAGE)[100]
    length = int.from_bytes(data[at + 1 : at + 9], "little")
    data[at + 1 : at + 9] = (length + off).to_bytes(8, "little")
    file.write_bytes(data)
    done = recover(file)
    assert contents(done.folder) == expected(written)[:100]
    assert "run.mcap had 200 messages by its index, 100 were found" in done.findings
    assert "run.mcap has no checksum for 100 of these messages or their topics" in done.findings
    assert done.unprotected == 100
    assert done.dropped_bytes > 0


def test_ctrl_c_ends_a_recovery_and_leaves_nothing(tmp_path: Path) -> None:
    """The progress tells of every chunk, so a terminal is never silent for long."""
    record(tmp_path / "run", 200, flush_every=20)
    seen: list[int] = []

    def interrupt_later(count: int) -> None:
        seen.append(count)
        if len(seen) == 12:
            signal.raise_signal(signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        recover(tmp_path / "run", on_bytes=interrupt_later)
    assert max(seen) < 20_000
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


def test_an_empty_file_is_told(tmp_path: Path) -> None:
    written = record(tmp_path / "run", 1000, max_duration_ns=SECOND // 4)
    (tmp_path / "run" / "run_3.mcap").write_bytes(b"")
    done = recover(tmp_path / "run")
    assert contents(done.folder) == expected(written)[: done.messages]
    assert "run_3.mcap is empty: 0 bytes" in done.findings


def test_files_that_metadata_yaml_does_not_name_are_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    written = record(tmp_path / "run", 601, max_duration_ns=SECOND // 4)
    yaml_file = tmp_path / "run" / "metadata.yaml"
    text = yaml_file.read_text()
    assert text.count("run_2.mcap") == 2
    yaml_file.write_text(text.replace("  - run_2.mcap\n", ""))
    with open_bag(tmp_path / "run") as bag:
        assert bag.message_count < 601
        (warning,) = bag.warnings
        assert "does not name run_2.mcap" in warning and "stickslip bag recover" in warning
        assert caplog.messages == [warning]
    done = recover(tmp_path / "run")
    assert contents(done.folder) == expected(written)
    assert any("does not name run_2.mcap, which" in finding for finding in done.findings)
    (tmp_path / "run" / "run_1.mcap").unlink()
    done = recover(tmp_path / "run", tmp_path / "other")
    assert "metadata.yaml names run_1.mcap, which is not there" in done.findings
    assert any("counts 601 messages" in finding for finding in done.findings)


@pytest.mark.parametrize("chunks", [True, False])
def test_the_work_of_a_recovery_grows_with_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, chunks: bool
) -> None:
    """Of many topics, and of many records: calls of Python's functions are counted, not time."""
    calls = []
    for count in (10, 100, 200, 400):  # the first one imports what is imported late
        many = [
            (topic(f"/t{k}", STEPS.type), START + k, int32(k))
            for k in range(count)
            for _ in range(3)
        ]
        file = tmp_path / f"{count}.mcap"
        foreign(file, many, use_chunking=chunks, chunk_size=4000)
        file.write_bytes(file.read_bytes()[:-100])  # its index does not count
        calls.append(0)

        def note(*_: object) -> None:
            calls[-1] += 1

        sys.setprofile(note)
        try:
            done = recover(file)
        finally:
            sys.setprofile(None)
        assert done.messages == 3 * count
        with open_bag(done.folder) as bag:
            assert len(bag.topics) == count
    _, first, second, third = calls
    assert third - second < 2.2 * (second - first)


@pytest.mark.long
def test_a_bag_of_more_topics_than_its_metadata_can_hold(tmp_path: Path) -> None:
    """65 000 of them, as many as MCAP can number, made texts that filled the memory."""
    qos = STEPS.offered_qos
    many = [TopicDescription(f"/t{k}", STEPS.type, STEPS.schema, "", qos) for k in range(2000)]
    with BagWriter(tmp_path / "run", custom_data={"seed": "7"}, sync=False) as bag:
        for k, one in enumerate(many):
            bag.add_topic(one)
            bag.write(one.name, int32(k), log_ns=START + k, publish_ns=START)
    assert (tmp_path / "run" / "metadata.yaml").stat().st_size > 1024 * 1024
    data = (tmp_path / "run" / "run_0.mcap").read_bytes()
    assert all(
        int.from_bytes(data[at + 1 : at + 9], "little") < 10_000
        for at in records_of(data, Opcode.METADATA)
    )
    with open_bag(tmp_path / "run") as bag:
        assert len(bag.topics) == 2000 and bag.custom_data == {"seed": "7"}
        assert "metadata.yaml is too long; its bag is read without it" in bag.warnings[0]
    done = recover(tmp_path / "run")
    assert done.findings == ("metadata.yaml is too long to be read",)
    with Reader(done.folder) as reader:
        assert reader.message_count == done.messages == 2000


def test_false_chunks_inside_each_other_are_not_read_without_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each of 60 000 claims all that is left of the file: 88 GB would be read."""
    count, step = 60_000, 49
    data = bytearray(b"\x89MCAP0\r\n")
    for left in range(count * step, 0, -step):
        data += struct.pack("<BQQQQIIQ", 6, left - 9, 0, 0, max(1, left - 49), 1, 0, left - 49)
    (tmp_path / "run.mcap").write_bytes(data)
    read = []
    checksum = zlib.crc32

    def counted(part: bytes, before: int = 0) -> int:
        read.append(len(part))
        return checksum(part, before)

    monkeypatch.setattr("stickslip_ros.recordings.mcap_files.zlib.crc32", counted)
    assert recover(tmp_path / "run.mcap").messages == 0
    assert sum(read) < 300_000_000
