# SPDX-License-Identifier: Apache-2.0
"""An axis and a recorder under random commands for hours, watched from outside.

At the end the bag is held against what has to be in it, and the run in it is computed again.
"""

from __future__ import annotations

import contextlib
import os
import random
import statistics
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from std_srvs.srv import Trigger

from stickslip_ros.axis import Axis
from stickslip_ros.axis.commands import COMMANDS
from stickslip_ros.base.child_process import ChildError, ChildProcess, child_node
from stickslip_ros.base.errors import StickslipError
from stickslip_ros.physics.parameters import PARAMETERS, Parameters
from stickslip_ros.recordings import BagError, open_bag, resimulate
from stickslip_ros.ros.client import AxisClient, CommandRefused
from stickslip_ros.simulation import warm_up
from validation.campaigns.processes import memory_of, waited

AXIS, RECORDER = "/stickslip_axis", "/stickslip_recorder"
#: Growth of the memory in the second half that is still called none, MB
MOST_GROWTH = 2.0
_MOST_SAMPLES = 2000
_PAUSE = 0.2  # s between commands, on average
_TIMEOUT = 60.0  # s for an answer, on a machine that is busy with other things
_FEW_SAMPLES = 10  # with fewer, nothing can be said about growth


@dataclass(frozen=True)
class Sample:
    """What was seen at one moment."""

    time: float  #: s since the start
    memory: dict[str, float]  #: MB by process
    descriptors: dict[str, int]  #: open files and sockets by process
    missed: int  #: deadlines missed so far


@dataclass
class Soaked:
    """What came of it."""

    seed: int  #: of the random commands
    seconds: float = 0.0  #: that it took, without start and end
    interrupted: bool = False  #: before the time was up
    #: commands by name; and of these, those that were refused
    sent: Counter[str] = field(default_factory=Counter)
    refused: Counter[str] = field(default_factory=Counter)
    faults: int = 0  #: of the axis; each one was reset
    slowest: float = 0.0  #: s that the answer to a command took
    samples: list[Sample] = field(default_factory=list)
    messages: int = 0  #: in the bag; of these states were computed again
    states: int = 0
    lost: int = 0  #: messages that the recorder missed, as it says
    gaps: int = 0  #: places where the numbers of a publisher of the axis do not follow each other
    #: s for which the recorder waited for a processor: a machine with other work loses messages,
    #: and that is none of its doing
    waited: float = 0.0
    bit_for_bit: bool | None = None  #: whether every recorded state came out again; None: not tried
    #: what should not be, in words; empty if all is well
    findings: list[str] = field(default_factory=list)

    def growth(self, process: str) -> float | None:
        """Return by how much its memory grew in the second half, MB; None: too few samples.

        In the first half, buffers fill and events are collected for those who join late.
        """
        half = [sample.memory[process] for sample in self.samples[len(self.samples) // 2 :]]
        if len(half) < _FEW_SAMPLES:
            return None
        fifth = len(half) // 5
        return statistics.median(half[-fifth:]) - statistics.median(half[:fifth])

    def as_dict(self) -> dict[str, Any]:
        """Return it as plain values, SI units but for memory (MB)."""
        last = self.samples[-1] if self.samples else None
        names = list(last.memory) if last else []
        return {
            "seed": self.seed,
            "seconds": self.seconds,
            "interrupted": self.interrupted,
            "commands": dict(self.sent),
            "refused": dict(self.refused),
            "faults": self.faults,
            "slowest_answer": self.slowest,
            "memory_growth_mb": {name: self.growth(name) for name in names},
            "memory_mb": last.memory if last else {},
            "descriptors": last.descriptors if last else {},
            "missed_deadlines": last.missed if last else 0,
            "messages": self.messages,
            "lost": self.lost,
            "gaps": self.gaps,
            "recorder_waited": self.waited,
            "states": self.states,
            "bit_for_bit": self.bit_for_bit,
            "findings": self.findings,
        }


class RandomCommands:
    """Commands as users and mistakes make them: most are carried out, some have to be refused."""

    def __init__(self, seed: int) -> None:
        """Begin with a seed."""
        self._dice = random.Random(seed)
        usual = Axis(Parameters())
        # Set points that change nothing get no answer, and a pause would stop the time of the soak.
        self.names = [name for name in COMMANDS if name not in ("joint_command", "pause")]
        self._ranges = {
            name: command.limits(usual) for name, command in COMMANDS.items() if command.limits
        }
        # Within what a user would try; beyond, `_wrong` goes.
        self._ranges |= {
            "amplitude": (50.0, 300.0),
            "frequency": (50.0, 2000.0),
            "steps": (-300, 300),
            "jog": (-2000.0, 2000.0),
            "position": (-2e-5, 2e-5),
            "load": (-0.05, 0.05),
        }
        self.changeable = [
            row for row in PARAMETERS.values() if row.mutable and row.kind is float and row.default
        ]

    def pause(self) -> float:
        """Return how long to wait before the next one, s."""
        return self._dice.expovariate(1.0 / _PAUSE)

    def next(self) -> tuple[str, tuple[Any, ...]]:
        """Return the name and the arguments of the next command."""
        name = self._dice.choice(self.names)
        if name == "parameters":
            return name, (self._parameters(),)
        if name == "enable":
            return name, (self._dice.random() < 0.8,)
        if name == "trajectory":
            times = sorted(self._dice.uniform(0.0, 1.0) for _ in range(3))
            return name, ([(t, self._dice.uniform(-1e-5, 1e-5)) for t in times],)
        if name not in self._ranges:
            return name, ()
        if self._dice.random() < 0.05:
            return name, (self._wrong(name),)
        low, high = self._ranges[name]
        value = self._dice.uniform(low, high)
        return name, (round(value) if name == "steps" else value,)

    def _wrong(self, name: str) -> float:
        return 0 if name == "steps" else self._dice.choice((float("nan"), float("inf"), -1e12))

    def _parameters(self) -> dict[str, Any]:
        """Return some parameters within a factor of two of their defaults, or one of no sense."""
        if self._dice.random() < 0.05:
            return {"preload": -1.0}
        rows = self._dice.sample(self.changeable, self._dice.randint(1, 2))
        return {
            row.name: min(max(row.default * 2.0 ** self._dice.uniform(-1, 1), row.low), row.high)
            for row in rows
        }


def soak(
    folder: Path,
    seconds: float,
    seed: int,
    on_second: Callable[[float], object] = lambda s: None,
    params_file: Path | None = None,
) -> Soaked:
    """Run an axis, a recorder and random commands for some seconds; KeyboardInterrupt ends it.

    The bag and the logs go to a folder that is there. on_second is called with the seconds that
    have passed since the last call; the axis takes its parameters from params_file. Raises
    ChildError if a process does not start.
    """
    parameters = () if params_file is None else ("--params-file", str(params_file))
    found = Soaked(seed)
    bag = folder / "bag"
    warm_up()  # or the axis would compile when it has a minute to be ready
    with (
        child_node("recorder_node", folder, "-p", f"output:={bag}", own_session=True) as recorder,
        child_node("axis_node", folder, *parameters, own_session=True) as axis,
    ):
        recorder.wait_for("recording")
        axis.wait_for("ready")
        recorder.wait_for("first message of /joint_states")
        children = {"axis": axis, "recorder": recorder}
        with AxisClient(AXIS, timeout=_TIMEOUT, listeners=2) as client:
            try:
                _drive(client, children, found, seconds, on_second)
            except KeyboardInterrupt:
                found.interrupted = True
            except (ChildError, TimeoutError) as error:
                found.findings.append(str(error))
            _end(client, children, found)
    _judge(bag, found)
    return found


def _drive(
    client: AxisClient,
    children: dict[str, ChildProcess],
    found: Soaked,
    seconds: float,
    on_second: Callable[[float], object],
) -> None:
    """Send commands and look at the processes until the time is up."""
    commands = RandomCommands(found.seed)
    period = max(1.0, seconds / _MOST_SAMPLES)
    begin = time.monotonic()
    due = 0.0
    while (now := time.monotonic() - begin) < seconds:
        on_second(now - found.seconds)
        found.seconds = now
        if now >= due:
            due = now + period
            found.samples.append(_look(client, children, now))
        _send(client, commands, found)
        time.sleep(min(commands.pause(), seconds))
        found.waited = waited(children["recorder"].pid)
    found.seconds = time.monotonic() - begin


def _send(client: AxisClient, commands: RandomCommands, found: Soaked) -> None:
    if client.state == "fault":
        found.faults += 1
        client.send("reset")
    if client.state == "disabled":
        client.send("enable", True)
    name, arguments = commands.next()
    found.sent[name] += 1
    asked = time.monotonic()
    try:
        client.send(name, *arguments)
    except CommandRefused:
        found.refused[name] += 1
    found.slowest = max(found.slowest, time.monotonic() - asked)


def _look(client: AxisClient, children: dict[str, ChildProcess], now: float) -> Sample:
    for child in children.values():
        child.check_running()
    timing = client.report(_TIMEOUT)["timing"]
    return Sample(
        now,
        {name: memory_of(child.pid) for name, child in children.items()},
        {name: len(os.listdir(f"/proc/{child.pid}/fd")) for name, child in children.items()},
        int(timing["missed deadlines"]),
    )


def _end(client: AxisClient, children: dict[str, ChildProcess], found: Soaked) -> None:
    """End the axis, then the recorder, so that the bag holds all that the axis said."""
    try:
        with contextlib.suppress(CommandRefused):
            client.send("stop")
        children["axis"].interrupt()
        children["axis"].ended()
        recorder = client.node.create_client(Trigger, f"{RECORDER}/stop")
        answer: Any = recorder.call(Trigger.Request(), _TIMEOUT)
        if not (answer and answer.success):
            found.findings.append(f"the recorder did not close its bag: {answer}")
        children["recorder"].ended()
    except (ChildError, TimeoutError) as error:
        found.findings.append(str(error))


def _judge(bag: Path, found: Soaked) -> None:
    """Look for what is missing in the bag, run it again, add what should not be."""
    try:
        with open_bag(bag) as opened:
            found.messages = opened.message_count
            found.lost = int(opened.custom_data.get("lost_messages", "0"))
            last: dict[str, int] = {}
            for message in opened.messages():
                if message.topic.startswith(f"{AXIS}/") or message.topic == "/joint_states":
                    expected = last.get(message.topic, message.sequence - 1) + 1
                    found.gaps += message.sequence != expected
                    last[message.topic] = message.sequence
            (again,) = resimulate(opened)
        found.states, found.bit_for_bit = again.states, again.bit_for_bit
    except (BagError, StickslipError, ValueError) as error:
        found.findings.append(f"the bag cannot be run again: {error}")
    if found.bit_for_bit is False:
        found.findings.append("the run did not come out again bit for bit")
    if found.lost or found.gaps:
        found.findings.append(
            f"{found.lost} messages lost, {found.gaps} gaps in the bag; "
            f"the recorder waited for a processor for {found.waited:.0f} s"
        )
    for name in found.samples[-1].memory if found.samples else ():
        growth = found.growth(name)
        if growth is not None and growth > MOST_GROWTH:
            found.findings.append(f"the memory of the {name} grew by {growth:.1f} MB")
        first, last_one = found.samples[len(found.samples) // 2], found.samples[-1]
        if last_one.descriptors[name] > first.descriptors[name] + 2:
            found.findings.append(f"the {name} keeps more and more files open")
