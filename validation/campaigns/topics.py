# SPDX-License-Identifier: Apache-2.0
"""A drive commanded over topics, against one integrator of the whole system.

It is an axis in this process, in simulated time; a node of its own publishes ``command/steps`` and
hears ``~/truth``. What it hears at rest is held against the integrator at the time that the message
says.
"""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from sensor_msgs.msg import JointState
from std_msgs.msg import Int32

from stickslip_ros.physics.model.waveforms import command_of
from stickslip_ros.physics.parameters import Parameters
from stickslip_ros.ros.testing.in_process import InProcess
from stickslip_ros.testing import own_domain
from validation.draws import differing
from validation.whole_system import NoAnswerError, WholeSystem, positions

#: States of a command at least, and how many a second an axis publishes (1/s)
_STATES, _RATES = 8.0, (10.0, 1000.0)
#: Times between two states that the axis rests
_REST = 2.5
#: m/s of a runner that does not rest: a stamp, of whole ns, is off by more than is judged
_CARRIED = 1e-3
#: s of the machine for a command to be taken, and between looks
_HEARS, _LOOK = 10.0, 0.001


class Heard(NamedTuple):
    """What ``~/truth`` said at rest."""

    begun: float  #: s at which the command acted
    at: float  #: s of the message
    x: float  #: m


def send_steps(world: InProcess, steps: int) -> None:
    """Command steps over a topic; return when they have begun. NoAnswerError if they do not."""
    axis, deadline = world.nodes[0], time.monotonic() + _HEARS

    def until(ready: Callable[[], object]) -> None:
        while not ready():  # simulated time stands still meanwhile
            if time.monotonic() > deadline:
                raise NoAnswerError(f"the command was not taken within {_HEARS:g} s")
            time.sleep(_LOOK)

    topic = f"{axis.get_fully_qualified_name()}/command/steps"
    sent = world.node("user").create_publisher(Int32, topic, 10)
    until(sent.get_subscription_count)
    sent.publish(Int32(data=steps))
    until(lambda: axis.axis.moving)


def heard(p: Parameters, cycles: int, rate: float, folder: Path) -> Heard:
    """Command the steps of a drive over topics. NoAnswerError if the axis does not rest.

    rate: of the states that it publishes, 1/s.
    """
    lasts = cycles * command_of(p).period
    world = InProcess(folder, {**differing(p), "publish_rate": rate}, {}, own_time=True)
    try:
        true: list[tuple[int, float, float]] = []

        def hear(message: JointState) -> None:
            at, k = message.header.stamp, message.name.index("axis_slider")
            nanoseconds = 10**9 * at.sec + at.nanosec  # no float tells those since 1970
            true.append((nanoseconds, message.position[k], message.velocity[k]))

        user = world.node("ear")
        user.create_subscription(JointState, "/stickslip_axis/truth", hear, 1000)
        world.wait_until(lambda: true, what="a state")
        start = true[-1][0] - round(1e9 * world.now)
        send_steps(world, cycles)
        begun = world.now
        world.run(lasts + _REST / rate)
        at, x, v = true[-1]
        if abs(v) > _CARRIED:
            raise NoAnswerError(f"a load carries the runner off, at {v:.3g} m/s")
        return Heard(begun, 1e-9 * (at - start), x)
    finally:
        world.close()


def off(p: Parameters, cycles: int, radians: float) -> float:
    """Return how far (m a cycle) what is heard is from the integrator. Raises NoAnswerError."""
    lasts = cycles * command_of(p).period
    rate = float(np.clip(_STATES / lasts, *_RATES))
    if WholeSystem(p).fastest * (lasts + (_REST + 1.0) / rate) > radians:  # with the rests
        raise NoAnswerError("it takes too long")
    with (
        tempfile.TemporaryDirectory() as folder,
        own_domain(Path(folder), os.environ.__setitem__),
    ):
        one = heard(p, cycles, rate, Path(folder))
    rest = one.at - one.begun - lasts
    if rest <= 0.0:
        raise NoAnswerError("the axis was not heard at rest")
    expected = positions(p, cycles, rest=rest, before=one.begun)[-1]
    return abs(one.x - float(expected)) / cycles
