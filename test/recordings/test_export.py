# SPDX-License-Identifier: Apache-2.0
"""Recordings as tables: every message a row, every number as it was recorded."""

import csv
import os
import sys
from pathlib import Path

import numpy as np
import pytest
from bags import (
    EVENTS,
    JOINTS,
    SECOND,
    START,
    STEPS,
    STORE,
    event,
    foreign,
    int32,
    joint_state,
    record,
    serialized,
    topic,
)

from stickslip_ros.cli.main import main
from stickslip_ros.recordings import BagWriter, TopicDescription


def table(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_a_folder_takes_a_table_for_each_topic(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    written = record(tmp_path / "run", 100)
    assert main(["bag", "export", str(tmp_path / "run")]) == 0
    folder = tmp_path / "run_tables"
    assert capsys.readouterr().out.strip() == str(folder)
    steps, joints, events = (
        table(folder / f"{one.name[1:].replace('/', '.')}.csv") for one in (STEPS, JOINTS, EVENTS)
    )
    assert len(list(folder.iterdir())) == 3  # nothing came on the fourth topic
    assert [int(row["data"]) for row in steps] == [7, 27, 47, 67, 87]
    assert [int(row["recorded (ns)"]) for row in steps] == [
        ns for one, ns, _ in written if one is STEPS
    ]
    assert float(joints[3]["a_slider/position"]) == 4e-9  # the first message is an event
    assert float(joints[3]["time (s)"]) == pytest.approx(4e-3, abs=1e-9)
    assert float(joints[3]["a_piezo/velocity"]) == 1e-6
    assert (events[0]["event"], events[0]["preload"], events[0]["count"]) == ("start", "1.0", "")
    assert (events[1]["event"], events[1]["preload"], events[1]["count"]) == ("steps", "", "3")
    assert main(["bag", "export", str(tmp_path / "run")]) == 2
    assert "run_tables: File exists; choose another name" in capsys.readouterr().err


def test_a_file_takes_one_table_in_order_of_time(tmp_path: Path) -> None:
    """A moment is a row, whatever topics speak of it; two words of one topic are two rows."""
    pushed = TopicDescription("/pushed", JOINTS.type, JOINTS.schema)
    samples = [
        (JOINTS, START, joint_state(START, 1e-9)),
        (pushed, START, joint_state(START, 5e-9)),
        (pushed, START, joint_state(START, 6e-9)),
        (STEPS, START + 10**9, int32(3)),
    ]
    foreign(tmp_path / "run.mcap", samples)
    out = tmp_path / "all.csv"
    opened = len(os.listdir("/proc/self/fd"))
    assert main(["bag", "export", str(tmp_path / "run.mcap"), "--out", str(out)]) == 0
    assert len(os.listdir("/proc/self/fd")) == opened  # its database is closed with it
    rows = table(out)
    x, pushed_x = (f"{name}/a_slider/position" for name in ("/joint_states", "/pushed"))
    assert [(row[x], row[pushed_x], row[f"{STEPS.name}/data"]) for row in rows] == [
        ("1e-09", "5e-09", ""),
        ("", "6e-09", ""),
        ("", "", "3"),
    ]
    assert [float(row["time (s)"]) for row in rows] == [0.0, 0.0, 1.0]


def test_times_are_those_of_stamps_and_long_arrays_no_columns(tmp_path: Path) -> None:
    many = topic("/many", "std_msgs/msg/Float64MultiArray")
    layout = STORE.types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    arrays = [serialized(many.type, layout=layout, data=np.zeros(size)) for size in (64, 65)]
    late = joint_state(START + 2 * SECOND, 1e-9)
    samples = [(many, START, data) for data in arrays] + [(JOINTS, START + 5 * SECOND, late)]
    foreign(tmp_path / "run.mcap", samples)
    assert main(["bag", "export", str(tmp_path / "run.mcap")]) == 0
    (row,) = table(tmp_path / "run_tables" / "joint_states.csv")
    assert float(row["time (s)"]) == 2.0 and row["recorded (ns)"] == str(START + 5 * SECOND)
    short, long = table(tmp_path / "run_tables" / "many.csv")
    assert (short["data[63]"], long["data[0]"]) == ("0.0", "")


def test_a_table_has_one_clock_and_is_in_order_of_it(tmp_path: Path) -> None:
    """A command stood 4 s behind the event that applied it: the axis had dropped that time."""
    late = 4 * SECOND
    samples = [(EVENTS, START, event(START - 24 * SECOND, event="start"))]
    for k in range(10):
        now = START + k * SECOND
        lag = late if k > 4 else 0
        samples.append((JOINTS, now, joint_state(now - lag, k * 1e-9)))
        if k == 7:
            now += SECOND // 2
            samples.append((STEPS, now, int32(61)))
            samples.append((EVENTS, now, event(now - late, event="steps", value="61")))
    foreign(tmp_path / "run.mcap", samples)
    out = tmp_path / "all.csv"
    assert main(["bag", "export", str(tmp_path / "run.mcap"), "--out", str(out)]) == 0
    rows = table(out)
    times = [float(row["time (s)"]) for row in rows]
    assert times == sorted(times) and times[0] == -24.0
    (told,) = (row for row in rows if row[f"{STEPS.name}/data"])
    assert float(told["time (s)"]) == pytest.approx(3.5)
    assert told[f"{EVENTS.name}/event"] == "steps"


def test_parquet_holds_the_same(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    record(tmp_path / "run", 100)
    for name in ("all.csv", "all.parquet"):
        assert main(["bag", "export", str(tmp_path / "run"), "--out", str(tmp_path / name)]) == 0
    found = parquet.read_table(tmp_path / "all.parquet").to_pylist()
    assert [
        {name: "" if value is None else str(value) for name, value in row.items()} for row in found
    ] == table(tmp_path / "all.csv")


def test_what_cannot_be_exported_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    with BagWriter(tmp_path / "odd") as bag:
        bag.add_topic(TopicDescription("/odd", "a/msg/B", "", encoding="json"))
        bag.write("/odd", b"{}", log_ns=1, publish_ns=1)
    record(tmp_path / "run", 40)
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    for bag_name, out, words in (
        ("odd", "out", "has no messages that can be decoded"),
        ("run", "out.parquet", "pip install 'stickslip_ros[parquet]', or write .csv"),
        ("run", "gone/out.csv", "make its folder first"),
    ):
        arguments = [str(tmp_path / bag_name), "--out", str(tmp_path / out)]
        assert main(["bag", "export", *arguments]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert words in line
    assert sorted(path.name for path in tmp_path.iterdir()) == ["odd", "run"]


@pytest.mark.parametrize("out", ["tables", "all.csv", "all.parquet"])
def test_topics_that_cannot_be_decoded_are_left_out_and_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], out: str
) -> None:
    """They were left out without a word, or one of them kept all others from being exported."""
    words = {
        "/idl": TopicDescription(
            "/idl", "lab/msg/Words", "module lab {};", schema_encoding="omgidl"
        ),
        "/bare": TopicDescription("/bare", "lab/msg/Words", ""),
        "/part": TopicDescription("/part", "lab/msg/Words", "lab/Inner inner"),
        "/json": TopicDescription("/json", STEPS.type, STEPS.schema, encoding="json"),
        "/long": TopicDescription("/long", "lab/msg/Words", "int16 data"),
        "/short": TopicDescription("/short", "lab/msg/Words", "int64 data"),
    }
    with BagWriter(tmp_path / "run") as bag:
        for one in (STEPS, *words.values()):
            bag.add_topic(one)
            data = int32(7) + bytes(4) * (one.name == "/long")
            bag.write(one.name, data, log_ns=START, publish_ns=START)
    assert main(["bag", "export", str(tmp_path / "run"), "--out", str(tmp_path / out)]) == 1
    told = capsys.readouterr().err
    assert told.count("left out: ") == len(words) and all(one in told for one in words)
    assert (tmp_path / out).exists()
    assert main(["bag", "info", str(tmp_path / "run")]) == 0
    shown = capsys.readouterr().out
    assert shown.count("cannot be decoded") >= 2


ODD = "/a\x1b[2J\n\u202eb\x9b"


@pytest.mark.parametrize("action", ["info", "info --report page.html", "export", "recover"])
def test_characters_that_a_terminal_obeys_are_escaped(
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    action: str,
) -> None:
    """In every text of a foreign file: names, types, encodings, schemas, metadata."""
    monkeypatch.chdir(tmp_path)
    good = TopicDescription(ODD, STEPS.type, STEPS.schema)
    bad = TopicDescription(f"{ODD}c", ODD, ODD, schema_encoding=ODD, encoding=ODD)
    with BagWriter("run", custom_data={ODD: ODD}, ros_distro=ODD) as bag:
        for one in (good, bad):
            bag.add_topic(one)
            bag.write(one.name, int32(1), log_ns=START, publish_ns=START)
    name, *options = action.split()
    main(["bag", name, "run", *options])
    said = capfd.readouterr()
    texts = [said.out, said.err, *(file.name for file in tmp_path.rglob("*"))]
    texts += [file.read_text() for file in tmp_path.glob("*.html")]
    assert any("\\x1b" in text for text in texts) or name == "recover"
    for text in texts:
        assert not set(text) & {"\x1b", "\u202e", "\x9b"}
        assert "\n\\u202eb" not in text  # no line of its own


def test_topics_with_one_name_for_their_files_have_two(tmp_path: Path) -> None:
    names = ["/a/b", "/a.b", "/" + 200 * "c", "/" + 201 * "c"]
    samples = [(topic(name, STEPS.type), START, int32(k)) for k, name in enumerate(names)]
    foreign(tmp_path / "run.mcap", samples)
    assert main(["bag", "export", str(tmp_path / "run.mcap")]) == 0
    files = list((tmp_path / "run_tables").iterdir())
    assert sorted(table(file)[0]["data"] for file in files) == ["0", "1", "2", "3"]


def test_columns_that_come_late_are_empty_before(tmp_path: Path) -> None:
    """Rows are written before all columns are known."""
    events = [event(START + k, **{f"key {k}": "a,\r\nb"}) for k in range(4)]
    foreign(tmp_path / "run.mcap", [(EVENTS, START + k, one) for k, one in enumerate(events)])
    for out in ("tables", "all.csv"):
        assert (
            main(["bag", "export", str(tmp_path / "run.mcap"), "--out", str(tmp_path / out)]) == 0
        )
    rows = table(tmp_path / "tables" / "axis.events.csv")
    for k, row in enumerate(rows):
        assert [row[f"key {n}"] for n in range(4)] == ["a,\r\nb" * (n == k) for n in range(4)]
        assert None not in row and None not in row.values()
    joined = table(tmp_path / "all.csv")
    assert [row["/axis/events/key 3"] for row in joined] == ["", "", "", "a,\r\nb"]


def test_more_columns_than_any_disk_takes_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A key of its own in each message is a table whose size grows with their square."""
    with BagWriter(tmp_path / "run", sync=False) as bag:
        for one in (EVENTS, STEPS):
            bag.add_topic(one)
        bag.write(STEPS.name, int32(1), log_ns=START, publish_ns=START)
        for k in range(11):
            values = {f"{k}.{n}": "" for n in range(1000)}
            bag.write(EVENTS.name, event(START, **values), log_ns=START, publish_ns=START)
    assert main(["bag", "export", str(tmp_path / "run")]) == 1
    assert "more than 10000 columns" in capsys.readouterr().err
    assert [file.name for file in (tmp_path / "run_tables").iterdir()] == ["axis.command.steps.csv"]


def test_a_message_that_is_none_costs_its_topic_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Found when rows of it and of others are written already."""
    other = topic("/other", JOINTS.type)
    joints = [
        (one, START + k, joint_state(START, 0.0)) for k in range(50) for one in (JOINTS, other)
    ]
    foreign(tmp_path / "run.mcap", [*joints, (JOINTS, START + 99, b"\0\1\0\0\xff"), *joints[1:2]])
    for out in ("tables", "all.csv"):
        assert (
            main(["bag", "export", str(tmp_path / "run.mcap"), "--out", str(tmp_path / out)]) == 1
        )
        assert f"left out: a message on topic {JOINTS.name}" in capsys.readouterr().err
    assert [file.name for file in (tmp_path / "tables").iterdir()] == ["other.csv"]
    assert len(table(tmp_path / "all.csv")) == 51
    assert not any(JOINTS.name in name for name in table(tmp_path / "all.csv")[0])
