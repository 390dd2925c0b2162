# SPDX-License-Identifier: Apache-2.0
"""One table of damages to a bag of four chunks: who reads it refuses it, and recovery mends it."""

import random
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import pytest
from bags import JOINTS, SECOND, START, Sample, contents, expected, record, records_of
from mcap.opcode import Opcode

from stickslip_ros.cli.main import main
from stickslip_ros.recordings import BagError, open_bag, recover

IN_CHUNK, IN_INDEX = "the checksum of a chunk is wrong", "the checksum of its index is wrong"
LENGTHS = (1, 3, 10**6, 2**31, 2**40, 2**63, 2**64 - 1)


class Damage(NamedTuple):
    """What is done to the bytes, what a reader says of it, and what is lost for good."""

    name: str
    act: Callable[[bytearray], object]
    words: str = "run_0.mcap is damaged: .*stickslip bag recover"  #: none if nobody looks there
    lost: tuple[int, int] = (0, 0)  #: first message, and the first one behind them
    found: str = ""  #: what recovery has to say


def _chunk(data: bytearray, number: int) -> int:
    return records_of(data, Opcode.CHUNK)[number]


def _flip(data: bytearray, at: int) -> None:
    data[at] ^= 0x55


def _put(data: bytearray, at: int, value: bytes) -> None:
    data[at : at + len(value)] = value


def _length(data: bytearray, at: int, length: int) -> None:
    _put(data, at + 1, length.to_bytes(8, "little"))


def _without_checksum(data: bytearray) -> None:
    """Take away the checksum of the index."""
    _put(data, records_of(data, Opcode.FOOTER)[0] + 9 + 16, bytes(4))


def _rename_in_index(data: bytearray) -> None:
    """Four zero bytes in the name of a topic there: the chunks know it better."""
    at = data.rindex(JOINTS.name.encode(), records_of(data, Opcode.DATA_END)[0])
    _put(data, at + 5, bytes(4))


def _lose_name(data: bytearray) -> None:
    """Nothing but that index tells which topic the other chunks are of."""
    _flip(data, _chunk(data, 0) + 2000)
    _rename_in_index(data)


def _cut(data: bytearray, junk: int) -> None:
    """Half of the last chunk, and what a disk has behind it."""
    last = _chunk(data, 3)
    half = int.from_bytes(data[last + 1 : last + 9], "little") // 2
    data[last + half :] = random.Random(junk).randbytes(junk)


def _lie_about_time(data: bytearray) -> None:
    """A message outside of the time of its chunk would come out of order."""
    at = records_of(data, Opcode.CHUNK_INDEX)[0]
    _put(data, at + 9, struct.pack("<Q", START + SECOND // 1000))
    _without_checksum(data)


def _repeat(data: bytearray, start: int | None) -> None:
    """The second chunk once more; its first time, which no checksum protects, may be another."""
    second, third = _chunk(data, 1), _chunk(data, 2)
    again = bytearray(data[second:])
    if start is not None:
        _put(again, 9, start.to_bytes(8, "little"))
    data[third:] = again


def _hide_chunks(data: bytearray, off: int) -> None:
    """A record between chunks says it reaches into, or just behind, one of those that follow."""
    at = records_of(data, Opcode.MESSAGE_INDEX)[0]
    _length(data, at, _chunk(data, 3) + off - at - 9)


def damages() -> Iterator[Damage]:
    second = (100, 200)
    yield Damage("contents", lambda d: _flip(d, _chunk(d, 1) + 300), IN_CHUNK, second)
    yield Damage("first chunk", lambda d: _flip(d, _chunk(d, 0) + 2000), IN_CHUNK, (0, 100))
    yield Damage("checksum", lambda d: _flip(d, _chunk(d, 1) + 33), IN_CHUNK, second)
    yield Damage("size", lambda d: _flip(d, _chunk(d, 1) + 29), lost=second)
    counted = "400 messages are counted, 300 were found"
    yield Damage("kind", lambda d: _flip(d, _chunk(d, 1)), counted, second)
    yield Damage("gap", lambda d: d.__delitem__(slice(_chunk(d, 1) + 500, _chunk(d, 1) + 700)),
                 lost=second)  # fmt: skip
    yield Damage("zeros", lambda d: _put(d, _chunk(d, 1) - 50, bytes(750)), lost=second)
    yield Damage("noise", lambda d: d.__setitem__(slice(_chunk(d, 1), _chunk(d, 1)),
                 b"\x06" + bytes(8) + b"noise"))  # fmt: skip
    for junk in (0, 7, 5000):
        yield Damage(f"cut, {junk} behind", lambda d, n=junk: _cut(d, n), lost=(300, 400))  # type: ignore[misc]
    yield Damage("first chunk, and name in index", _lose_name, IN_INDEX, (0, 400))
    yield Damage("index", lambda d: _flip(d, records_of(d, Opcode.STATISTICS)[0] + 12), IN_INDEX)
    yield Damage("name in index", _rename_in_index, IN_INDEX, found=IN_INDEX)
    yield Damage("time in index", _lie_about_time, "outside the time range of the index")
    for start in (None, 0):
        yield Damage(f"twice, {start}", lambda d, s=start: _repeat(d, s),  # type: ignore[misc]
                     found="bytes were left out")  # fmt: skip
    for off in (1000, 0, -40):
        yield Damage(f"hidden, {off}", lambda d, o=off: _hide_chunks(d, o), "",  # type: ignore[misc]
                     found="bytes were left out")  # fmt: skip
    for kind in (Opcode.HEADER, Opcode.CHUNK, Opcode.STATISTICS, Opcode.FOOTER):
        for length in LENGTHS:
            yield Damage(
                f"length {length} of {kind.name}",
                lambda d, k=kind, n=length: _length(d, records_of(d, k)[0], n),  # type: ignore[misc]
                lost=(0, 100 if kind == Opcode.CHUNK else 0),
            )


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[Sample], Path, bytes]:
    """What is in a bag of four chunks, its file, and the bytes of that."""
    folder = tmp_path_factory.mktemp("damage") / "run"
    written = record(folder, 400, flush_every=100)
    file = folder / "run_0.mcap"
    assert len(records_of(file.read_bytes(), Opcode.CHUNK)) == 4
    return written, file, file.read_bytes()


def refused(path: Path, words: str, name: str) -> None:
    with pytest.raises(BagError, match=words) as error, open_bag(path) as bag:
        for _ in bag.messages():
            pass
    assert "\n" not in str(error.value), name


def test_who_reads_it_is_told_what_is_wrong_and_the_cure(
    sound: tuple[list[Sample], Path, bytes], capsys: pytest.CaptureFixture[str]
) -> None:
    written, file, whole = sound
    for left in (0, 3, 8, 30, 5000, -1):
        file.write_bytes(whole[:left])
        refused(file.parent, Damage("cut", len).words, f"cut to {left}")
        assert main(["bag", "info", str(file.parent)]) == 2
        assert "stickslip bag recover" in capsys.readouterr().err
    for damage in damages():
        data = bytearray(whole)
        damage.act(data)
        file.write_bytes(data)
        if damage.words:
            refused(file.parent, damage.words, damage.name)
        else:
            assert contents(file.parent) == expected(written), damage.name


def test_damage_costs_no_more_than_the_chunk_it_is_in(
    sound: tuple[list[Sample], Path, bytes], tmp_path: Path
) -> None:
    written, file, whole = sound
    for number, damage in enumerate(damages()):
        data = bytearray(whole)
        damage.act(data)
        file.write_bytes(data)
        done = recover(file.parent, tmp_path / f"{number}")
        first, behind = damage.lost
        kept = [one for i, one in enumerate(expected(written)) if not first <= i < behind]
        assert contents(done.folder) == kept, damage.name
        told = f"400 messages, {len(kept)} were found" if behind > first else damage.found
        assert (done.dropped_bytes > 0) >= (behind > first), damage.name
        said = " ".join(done.findings)
        assert told in said, damage.name
        assert ("no checksum" in said) == (done.unprotected > 0), damage.name
