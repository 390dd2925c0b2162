# SPDX-License-Identifier: Apache-2.0
"""Times that are hours from all others, and clocks beside that of the recorder."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import pytest
from bags import (
    EVENTS,
    JOINTS,
    SECOND,
    START,
    STEPS,
    Sample,
    event,
    foreign,
    int32,
    joint_state,
    topic,
)

from stickslip_ros.cli.main import main
from stickslip_ros.measurement.bags.load_motion import load_motion
from stickslip_ros.measurement.reading import MeasurementError
from stickslip_ros.recordings import BagWriter, OfferedQos, open_bag
from stickslip_ros.recordings.clocks import Bulk, bulk_of

DAY = 24 * 3600 * SECOND
MS = SECOND // 1000


def table(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def joints(count: int, start: int = START, since: int = START) -> list[Sample]:
    """Joint states, one each millisecond from a time on, with stamps from another on, ns."""
    return [(JOINTS, start + k * MS, joint_state(since + k * MS, 1e-9 * k)) for k in range(count)]


@pytest.mark.parametrize("late", [-DAY, DAY])
def test_few_times_that_are_hours_from_the_others_are_apart(late: int) -> None:
    times = [START + k * MS for k in range(14_000)]
    found = bulk_of([*times, times[0] + late])
    assert found[:3] == (times[0], times[-1], 1)
    assert found.told.startswith("1 message is 86 400 s from the others")
    assert bulk_of([*times, *(START + late + k for k in range(100))]).apart == 100
    assert bulk_of([*times, *(START + late + k for k in range(200))]).apart == 0  # not few


def test_what_a_clock_shows_that_was_not_set_is_apart() -> None:
    now = [START, START + SECOND]
    assert bulk_of([0, 1, *now]) == Bulk(START, START + SECOND, 2, START)
    simulated = [k * SECOND for k in range(10)]  # from 0 on is no mistake
    assert bulk_of(simulated) == Bulk(0, 9 * SECOND)
    assert bulk_of([]) == Bulk(0, 0)
    days = [START + k * DAY for k in range(40)]  # none of them is apart from the others
    assert bulk_of(days) == Bulk(days[0], days[-1])
    several = bulk_of([START] * 50 + [0] * 49)
    assert several.told == "49 messages are up to 1 700 000 000 s from the others: left out"


@pytest.mark.parametrize("what", ["recorded a day late", "stamped a day late", "recorded at 1 ns",
                                  "stamped 0"])  # fmt: skip
def test_a_message_apart_is_left_out_and_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], what: str
) -> None:
    """It took 35 s and 2 GB to say that the trace shows no steps; now each command names it."""
    samples, number = joints(2000), 1999 if "late" in what else 0
    log, stamp = samples[number][1], samples[number][1]
    if what.startswith("recorded"):
        log = START + 2 * SECOND + DAY if "late" in what else 1
    else:
        stamp = stamp + DAY if "late" in what else 0
    samples[number] = JOINTS, log, joint_state(stamp, 1e-9 * number)
    bag = tmp_path / "run.mcap"
    foreign(bag, samples)
    seconds = "86 400" if "late" in what else "1 700 000 000"
    told = f"1 message is {seconds} s from the others: left out"
    with open_bag(bag) as found:
        assert found.message_count == len(list(found.messages())) == 2000
        apart = what.startswith("recorded")
        assert found.bulk.told.startswith(told) == apart
        assert len(list(found.bulk_messages())) == 2000 - apart
    assert main(["bag", "info", str(bag), "--json"]) == 0
    about = json.loads(capsys.readouterr().out)
    assert about["duration"] < 2.0 and len(about["warnings"]) == apart
    assert main(["bag", "info", str(bag)]) == 0
    assert (told in capsys.readouterr().out) == apart
    assert main(["bag", "export", str(bag), "--out", str(tmp_path / "tables")]) == 0
    assert told in capsys.readouterr().err
    assert len(table(tmp_path / "tables" / "joint_states.csv")) == 1999
    motion = load_motion(bag).motion
    assert len(motion.t) == 1999 and motion.t[-1] < 2.0
    assert any(told in note for note in motion.notes)


def test_tables_have_the_clock_of_their_stamps(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """An axis of simulated time had times of -1.8e9 s beside a recorder's of 1 to 10."""
    own, late = topic("/diagnostics", EVENTS.type), START + SECOND
    samples = [(own, START + k * SECOND, event(START + k * SECOND, a="b")) for k in range(4)]
    samples += joints(2000, START + SECOND, 5 * SECOND)
    samples += [(EVENTS, late, event(5 * SECOND, event="start")), (STEPS, late + SECOND, int32(3))]
    samples.sort(key=lambda one: one[1])
    foreign(tmp_path / "run.mcap", samples)
    assert main(["bag", "export", str(tmp_path / "run.mcap"), "--out", str(tmp_path / "t")]) == 0
    said = capsys.readouterr().err
    assert "the stamps of /axis/events, /joint_states are by another clock" in said
    times = {
        path.stem: [float(row["time (s)"]) for row in table(path)]
        for path in (tmp_path / "t").iterdir()
    }
    assert times["diagnostics"] == [0.0, 1.0, 2.0, 3.0]
    assert times["joint_states"][:2] == [0.0, 0.001] and len(times["joint_states"]) == 2000
    assert (times["axis.events"], times["axis.command.steps"]) == ([0.0], [1.0])
    out = tmp_path / "all.csv"
    assert main(["bag", "export", str(tmp_path / "run.mcap"), "--out", str(out)]) == 0
    rows = table(out)
    assert {row["clock"] for row in rows} == {"recorder", "/axis/events"}
    for row in rows:
        assert (row["clock"] == "recorder") == bool(row["/diagnostics/a"])
    assert [float(row["time (s)"]) for row in rows] == sorted(
        float(row["time (s)"]) for row in rows
    )


def test_events_from_long_before_the_recording_are_kept(tmp_path: Path) -> None:
    """An axis may have run for days; its start is told to who joins late."""
    kept = replace(EVENTS, offered_qos=(OfferedQos(durability="transient_local"),))
    begin = START - 5 * DAY
    with BagWriter(tmp_path / "run") as bag:
        for one in (kept, JOINTS):
            bag.add_topic(one)
        stamps = [begin, *(START + k * MS for k in range(50))]
        for one, ns, data in [*((kept, START, event(ns, a="b")) for ns in stamps), *joints(50)]:
            bag.write(one.name, data, log_ns=ns, publish_ns=ns)
    assert main(["bag", "export", str(tmp_path / "run"), "--out", str(tmp_path / "t")]) == 0
    times = [float(row["time (s)"]) for row in table(tmp_path / "t" / "axis.events.csv")]
    assert times[:2] == [-5 * DAY / SECOND, 0.0] and len(times) == 51


def test_joints_of_one_name_are_told_apart_by_their_namespaces(tmp_path: Path) -> None:
    """The error advised --joint a_slider, which was refused with columns that are not of one."""
    samples = [
        (topic(f"/{name}/joint_states", JOINTS.type), START + k * MS,
         joint_state(START + k * MS, x * k))
        for k in range(100) for name, x in (("l1", 1e-9), ("l2", 2e-9))
    ]  # fmt: skip
    foreign(tmp_path / "run.mcap", samples)
    for joint in (None, "a_slider"):
        with pytest.raises(MeasurementError, match=r"l1/a_slider, l2/a_slider; .*--joint l1/a_sl"):
            load_motion(tmp_path / "run.mcap", joint=joint)
    for joint, x in (("l1/a_slider", 99e-9), ("l2/a_slider", 198e-9)):
        motion = load_motion(tmp_path / "run.mcap", joint=joint).motion
        assert motion.x[-1] == pytest.approx(x) and motion.u is not None
