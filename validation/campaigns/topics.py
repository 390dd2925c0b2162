# SPDX-License-Identifier: Apache-2.0
"""Random drives commanded over topics, against one integrator of the whole system.

Drives are those of `drives`. Each is an axis in this process, in simulated time; a node of its own
publishes ``command/steps`` and hears ``~/truth``. What it hears at rest is held to 0.01 nm a cycle
against the integrator at the time that the message says.
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

from stickslip_ros.errors import StickslipError
from stickslip_ros.model.waveforms import command_of
from stickslip_ros.parameters import Parameters
from stickslip_ros.ros.in_process import InProcess
from stickslip_ros.testing.plugin import own_domain
from validation.campaigns.arguments import arguments
from validation.campaigns.drives import ALLOWED, CYCLES, EFFECTS, FASTEST, drives
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


def _rate(p: Parameters) -> float:
    """Return how many states an axis publishes, 1/s."""
    return float(np.clip(_STATES / (CYCLES * command_of(p).period), *_RATES))


def _lasting(p: Parameters, rate: float) -> float:
    """Return the time (s) from the start to the state that is judged."""
    return CYCLES * command_of(p).period + (_REST + 1.0) / rate


def heard(p: Parameters, folder: Path) -> Heard:
    """Command the steps of a drive over topics. NoAnswerError if the axis does not rest."""
    lasts, rate = CYCLES * command_of(p).period, _rate(p)
    world = InProcess(folder, {**differing(p), "publish_rate": rate}, {}, own_time=True)
    try:
        user, true = world.node("user"), list[tuple[int, float, float]]()

        def hear(message: JointState) -> None:
            at, k = message.header.stamp, message.name.index("axis_slider")
            nanoseconds = 10**9 * at.sec + at.nanosec  # no float tells those since 1970
            true.append((nanoseconds, message.position[k], message.velocity[k]))

        user.create_subscription(JointState, "/stickslip_axis/truth", hear, 1000)
        steps = user.create_publisher(Int32, "/stickslip_axis/command/steps", 10)
        world.wait_until(lambda: true and steps.get_subscription_count(), what="a state")
        start = true[-1][0] - round(1e9 * world.now)
        steps.publish(Int32(data=CYCLES))
        deadline = time.monotonic() + _HEARS
        while not world.nodes[0].axis.moving:  # simulated time stands still meanwhile
            if time.monotonic() > deadline:
                raise NoAnswerError(f"the command was not taken within {_HEARS:g} s")
            time.sleep(_LOOK)
        begun = world.now
        world.advance(lasts + _REST / rate)
        at, x, v = true[-1]
        if abs(v) > _CARRIED:
            raise NoAnswerError(f"a load carries the runner off, at {v:.3g} m/s")
        return Heard(begun, 1e-9 * (at - start), x)
    finally:
        world.close()


def off(p: Parameters, one: Heard) -> float:
    """Return how far the integrator is from what was heard, nm a cycle. Raises NoAnswerError."""
    rest = one.at - one.begun - CYCLES * command_of(p).period
    if rest <= 0.0:
        raise NoAnswerError("the axis was not heard at rest")
    expected = positions(p, CYCLES, rest=rest, before=one.begun)[-1]
    return 1e9 * abs(one.x - float(expected)) / CYCLES


def main(argv: list[str] | None = None, say: Callable[[str], object] = print) -> int:
    """Run drives of each effect in turn; the exit code is 1 if one is off by more than allowed."""
    args = arguments(__doc__, argv, count=200, seed=1, real=False, radians=FASTEST)
    lots = [drives(effect, args.seed, args.real, args.radians) for effect in (*EFFECTS, "all")]
    found: list[float] = []
    left_out = 0
    number = 0
    while len(found) < args.count:
        p = next(lots[number % len(lots)])
        number += 1
        if WholeSystem(p).fastest * _lasting(p, _rate(p)) > args.radians:  # with the rests
            continue
        try:
            with (
                tempfile.TemporaryDirectory() as folder,
                own_domain(Path(folder), os.environ.__setitem__),
            ):
                one = heard(p, Path(folder))
            found.append(off(p, one))
        except (NoAnswerError, StickslipError, TimeoutError) as error:
            left_out += 1
            say(f"  left out: {type(error).__name__} {error}: {differing(p)}")
            continue
        if not found[-1] <= 1e9 * ALLOWED:
            say(f"  off {found[-1]:.3g} nm a cycle: {differing(p)}")
    beyond = sum(not one <= 1e9 * ALLOWED for one in found)
    say(
        f"{len(found)} drives over topics, median {np.median(found):.2g}, worst {max(found):.2g} "
        f"nm a cycle, {beyond} beyond; besides, {left_out} left out"
    )
    return int(beyond > 0)


if __name__ == "__main__":
    raise SystemExit(main())
