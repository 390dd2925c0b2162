# SPDX-License-Identifier: Apache-2.0
"""Every call of the operating system fails once, in turn, and the power fails at any time."""

import json
import random
import tracemalloc
from collections import Counter
from pathlib import Path

import pytest
import short_of_memory
from bags import JOINTS, SECOND, START, STEPS, int32, joint_state, record, samples
from child import python
from file_layer import FileLayer, each_fault
from mcap.reader import make_reader
from test_bag_resimulation import record_axis

from stickslip_ros.base.errors import StickslipError
from stickslip_ros.recordings import BagError, BagWriter, open_bag, recover, resimulate

MS = 1_000_000


def times(folder: Path) -> list[int]:
    with open_bag(folder) as bag:
        return [message.log_ns for message in bag.messages()]


class Promises:
    """A recorder that notes what it was promised."""

    def __init__(self) -> None:
        self.kept: dict[Path, int] = {}

    def record(self, layer: FileLayer, place: Path) -> None:
        self.kept[place] = 0
        with BagWriter(place / "run", max_duration_ns=30 * MS) as bag:
            bag.add_topic(STEPS)
            for number in range(90):
                bag.write(STEPS.name, int32(number), log_ns=number * MS, publish_ns=0)
                if number % 15 == 14:
                    bag.flush()
                    bag.wait_for_disk()
                    self.kept[place] = number + 1


@pytest.mark.parametrize("broken", [False, True], ids=["once", "from then on"])
def test_nothing_that_was_flushed_is_lost_whatever_fails(tmp_path: Path, broken: bool) -> None:
    promises = Promises()
    told = set()
    for call, raised, place in each_fault(promises.record, tmp_path, broken):
        told.add(call.split()[0])
        kept = promises.kept[place]
        assert raised is None or isinstance(raised, BagError), call
        if raised is None:
            assert call.startswith(("unlink", "rmdir")), call
            assert times(place / "run") == [number * MS for number in range(90)]
            continue
        assert "make room on the disk" in str(raised) and "run" in str(raised), call
        if not list(place.glob("run/*")):
            assert kept == 0, call
            continue
        done = recover(place / "run")
        found = times(done.folder)
        assert found == [number * MS for number in range(len(found))], call
        assert len(found) >= kept, call
        try:
            read = times(place / "run")  # what can be read without it is no lie either
        except BagError:
            continue
        assert read == found[: len(read)], call
    assert {"mkdir", "open", "write", "fsync", "replace"} <= told


@pytest.mark.parametrize("broken", [False, True], ids=["once", "from then on"])
@pytest.mark.parametrize("way", ["recovered", "computed"])
def test_a_bag_made_of_another_is_whole_or_not_there(
    tmp_path: Path, broken: bool, way: str
) -> None:
    old = tmp_path / "old"
    record(old, 60, flush_every=20) if way == "recovered" else record_axis(old)

    def make(layer: FileLayer, place: Path) -> None:
        if way == "recovered":
            recover(old, place / "new")
            return
        with open_bag(old) as bag:
            resimulate(bag, {"mass": 0.006}, place / "new")

    told = set()
    for call, raised, place in each_fault(make, tmp_path, broken):
        told.add(call.split()[0])
        assert raised is None or isinstance(raised, StickslipError), call
        if (place / "new").exists():
            assert len(times(place / "new")) == len(times(old)), call
            continue
        assert "new" in str(raised) and "make room on the disk" in str(raised), call
        if not call.startswith(("rmdir", "unlink")) and not broken:
            assert list(place.iterdir()) == [], call
    assert {"mkdir", "open", "write", "fsync", "rename"} <= told


def test_a_power_cut_costs_a_second_at_most(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is on the disk is what was there at the last fsync, at any time of the recording."""
    dice = random.Random(3)
    cuts = sorted(dice.sample(range(1, 4000), 12))
    states = []
    work = tmp_path / "work"
    work.mkdir()
    with pytest.MonkeyPatch.context() as patch:
        layer = FileLayer(patch, work)
        with BagWriter(work / "run", compression="zstd", max_duration_ns=SECOND) as bag:
            bag.add_topic(JOINTS)
            for ms in range(4000):
                now = START + ms * MS
                bag.write(JOINTS.name, joint_state(now, 1e-9 * ms), log_ns=now, publish_ns=now)
                if ms % 500 == 499:
                    bag.flush()
                    bag.wait_for_disk()
                if ms in cuts:
                    layer.after_power_cut(tmp_path / f"cut_{ms}")
                    states.append((ms, tmp_path / f"cut_{ms}" / "run"))
        layer.after_power_cut(tmp_path / "closed")
    assert len(times(tmp_path / "closed" / "run")) == 4000
    for ms, folder in states:
        found = times(recover(folder).folder)
        assert found == [START + number * MS for number in range(len(found))]
        assert len(found) > ms - 1000, ms


@pytest.mark.parametrize("sync", [True, False])
def test_without_sync_only_closing_waits_for_the_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sync: bool
) -> None:
    layer = FileLayer(monkeypatch, tmp_path)
    with BagWriter(tmp_path / "run", sync=sync) as bag:
        bag.add_topic(STEPS)
        bag.write(STEPS.name, int32(1), log_ns=1, publish_ns=1)
        layer.calls.clear()
        bag.flush()
        bag.wait_for_disk()
        assert any(call.startswith("fsync") for call in layer.calls) == sync
        layer.calls.clear()
    assert any(call == "fsync run_0.mcap" for call in layer.calls)


@pytest.mark.long
def test_the_memory_of_a_recording_does_not_grow(tmp_path: Path) -> None:
    """Six thousand chunks, 18 minutes of an axis; each took some hundred bytes to the end."""
    written = [data for one, _, data in samples(2) if one is JOINTS]
    with BagWriter(tmp_path / "run", sync=False) as bag:
        for topic in (JOINTS, STEPS):
            bag.add_topic(topic)

        def chunks(first: int, count: int) -> None:
            for number in range(first, first + count):
                bag.write(JOINTS.name, written[0], log_ns=number, publish_ns=number)
                bag.write(STEPS.name, int32(number), log_ns=number, publish_ns=number)
                bag.flush()

        chunks(0, 4000)  # the index has gone to its file by then
        tracemalloc.start()
        chunks(4000, 1)
        before = tracemalloc.get_traced_memory()[0]
        chunks(4001, 1999)
        grown = tracemalloc.get_traced_memory()[0] - before
        tracemalloc.stop()
    assert grown < 50_000
    with (tmp_path / "run" / "run_0.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
        assert summary and len(summary.chunk_indexes) == 6_000
        assert all(len(index.message_index_offsets) == 2 for index in summary.chunk_indexes)
    assert len(times(tmp_path / "run")) == 12_000


@pytest.mark.parametrize("compression", ["none", "zstd"])
def test_nothing_that_was_flushed_is_lost_when_memory_runs_out(
    tmp_path: Path, compression: str
) -> None:
    """One allocation after the other fails, by a tool of CPython's own tests."""
    pytest.importorskip("_testcapi")
    child = python(short_of_memory.__file__, str(tmp_path), compression, "40", "1")
    assert child.returncode == 0, child.stderr
    told: Counter[str] = Counter()
    for number, (given, flushed, said) in enumerate(json.loads(child.stdout)):
        run = tmp_path / f"run_{number}"
        told[said.partition(":")[0]] += 1
        if not flushed and not list(run.glob("*")):
            assert said != "whole"
            continue
        try:
            found = times(run)
            assert said != "whole" or len(found) == short_of_memory.MESSAGES
        except BagError:
            assert said != "whole"
            found = times(recover(run).folder)
        assert found == [START + number for number in range(len(found))], said
        assert flushed <= len(found) <= given + 1, said
        if said.startswith("BagError"):
            assert "the bag " in said and "out of memory; ask for less" in said
    assert told["BagError"] and told["whole"]
