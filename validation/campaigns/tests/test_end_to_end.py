# SPDX-License-Identifier: Apache-2.0
"""Axis, recorder and client together, over DDS, read back with ``rosbags``.

``STICKSLIP_SOAK_S`` sets how long the recorded run takes, 10 s by default: long enough to judge
the rate of the published state, short enough for every day.
"""

import os
from collections import defaultdict
from itertools import cycle, pairwise
from pathlib import Path
from typing import Any

import pytest
from live import Process, Ros, Start
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from sensor_msgs.msg import JointState

from stickslip_ros.ros.client import AxisClient

pytestmark = pytest.mark.long
SOAK = float(os.environ.get("STICKSLIP_SOAK_S", "10"))  # s
RATE = 100.0  # Hz, of the published state
PATIENCE = 10.0  # s
STATES = ("/joint_states", "/stickslip_axis/contact")


def _nanoseconds(message: Any) -> int:
    return int(message.header.stamp.sec) * 10**9 + int(message.header.stamp.nanosec)


def _rate(stamps: list[int], moves: list[int]) -> float:
    """Return the rate (Hz) of the messages over the last 10 s, but for one with each move."""
    begin = stamps[-1] - 10**10
    last = [stamp for stamp in stamps if stamp >= begin]
    out_of_turn = sum(stamp >= begin for stamp in moves)
    return (len(last) - 1 - out_of_turn) * 1e9 / (last[-1] - last[0])


def _missed(diagnostics: Any) -> int:
    """Return the deadlines missed since the start, as the axis says."""
    (timing,) = (s for s in diagnostics.status if s.name == "stickslip_axis: timing")
    return int({pair.key: pair.value for pair in timing.values}["missed deadlines"])


def _read(folder: Path) -> dict[str, list[Any]]:
    """Return the messages of a bag by topic, as the independent reader understands them."""
    messages: dict[str, list[Any]] = defaultdict(list)
    with AnyReader([folder]) as reader:
        for connection, _, data in reader.messages():
            messages[connection.topic].append(reader.deserialize(data, connection.msgtype))
    return messages


def _numbers(folder: Path, topic: str) -> list[int]:
    """Return the numbers that the publisher gave its messages, in the order of the file."""
    with (folder / f"{folder.name}_0.mcap").open("rb") as stream:
        return [record.sequence for _, _, record in make_reader(stream).iter_messages(topic)]


@pytest.fixture
def recorder(start_node: Start) -> Process:
    process = start_node("recorder_node", output="bag")
    process.wait_for("recording")
    return process


@pytest.fixture
def axis(recorder: Process, start_node: Start) -> Process:
    process = start_node("axis_node")
    process.wait_for("ready")
    recorder.wait_for("first message of /joint_states")  # from now on nothing may be missing
    return process


def test_nothing_is_lost_between_node_and_bag(
    ros: Ros, recorder: Process, axis: Process, tmp_path: Path
) -> None:
    """Moves without a pause; then the bag is held against what must have been published.

    - Numbers: those that the publisher counts its messages with have no gap.
    - Ticks: every deadline of the axis either gave a message or is one that it says it missed;
      every command to move gave one more, out of turn.
    - A second listener, which came later, has heard what the bag holds from there to the end.
    - Rate: as many messages as 100 Hz make over the last 10 s of their stamps, within 1 %; the
      stamps rise strictly. If something else held up the machine, 10 s without it are waited for.
    """
    heard: list[int] = []
    moved: list[int] = []
    listener = ros.node()
    listener.create_subscription(
        JointState, "/joint_states", lambda m: heard.append(_nanoseconds(m)), 1000
    )
    client = AxisClient(node=ros.node("client"), listeners=2)
    ros.wait_until(lambda: heard, "a joint state")
    moves = cycle([(1000.0, 200), (1000.0, -200), (100.0, 20)])
    while (took := 1e-9 * (heard[-1] - heard[0])) < SOAK or (
        abs(_rate(heard, moved) - RATE) > 0.01 * RATE and took < SOAK + PATIENCE
    ):
        frequency, steps = next(moves)
        client.send("frequency", frequency).send("steps", steps).wait()
        moved.append(heard[-1])
    assert axis.interrupt() == 0
    assert recorder.interrupt() == 0

    folder = tmp_path / "bag"
    messages = _read(folder)
    for topic in STATES:
        numbers = _numbers(folder, topic)
        assert numbers == list(range(numbers[0], numbers[0] + len(messages[topic])))
    assert ", lost 0, " in recorder.output
    stamps = [_nanoseconds(m) for m in messages["/joint_states"]]
    contact = [_nanoseconds(m) for m in messages["/stickslip_axis/contact"]]
    both = max(stamps[0], contact[0])
    assert [t for t in stamps if t >= both] == [t for t in contact if t >= both]
    ros.wait_until(lambda: heard[-1] == stamps[-1], "the last state")
    assert heard == stamps[stamps.index(heard[0]) :]
    assert all(a < b for a, b in pairwise(stamps))

    # The recorder reports there as well.
    reports = [m for m in messages["/diagnostics"] if m.status[0].hardware_id == "stickslip_axis"]
    status = reports[-1]
    missed = _missed(status)
    ticks = sum(stamp <= _nanoseconds(status) for stamp in stamps)
    # What is held up when the axis reports is counted when it goes on.
    until = [(t - stamps[0]) * 1e-9 for t in (stamps[ticks - 1], _nanoseconds(status))]
    early = _missed(reports[0])  # some of them perhaps before the first message
    finished = [
        (_nanoseconds(message), event)
        for message in messages["/stickslip_axis/events"]
        for event in message.status
        if event.message == "move finished"
    ]
    ends = [stamp for stamp, _ in finished]
    ended = sum(stamp <= _nanoseconds(status) for stamp in ends)  # one more may have begun
    seconds = f"{until[1]:.1f} s"
    print(f"{seconds}: {ticks} messages, {missed} deadlines missed, {len(stamps)} in the bag")
    deadlines = ticks - ended + missed
    assert RATE * until[0] - 2 <= deadlines <= RATE * until[1] + 3 + early
    if missed == early:  # else something held up the machine, and the axis has said so
        assert _rate(stamps, ends) == pytest.approx(RATE, rel=0.01)

    commands = messages["/stickslip_axis/command/steps"]
    values = [{pair.key: pair.value for pair in event.values} for _, event in finished]
    assert [int(v["steps"]) for v in values] == [int(m.data) for m in commands]
