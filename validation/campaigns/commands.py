# SPDX-License-Identifier: Apache-2.0
"""Random commands and parameters, one after the other, on axes of any kind, without ROS.

Parameters are changed by up to a factor of a hundred, or to an end of their range, while whatever
was commanded goes on. Each command has to be carried out or refused, and the axis has to tell its
status and go on in time after each; a fault is reset.
"""

from __future__ import annotations

import random
import time
import traceback
from collections.abc import Sequence
from typing import Any

from stickslip_ros.axis import Axis
from stickslip_ros.base.errors import StickslipError
from stickslip_ros.physics.parameters import Parameters
from stickslip_ros.physics.parameters.row import Parameter
from validation.soak.run import RandomCommands

#: s of simulated time of each axis, and of the processor at most
LASTS, TAKES = 40.0, 5.0
PERIOD = 1.0 / 60.0  #: s between commands, in the mean
#: What an axis may have, and with which probability
EFFECTS: tuple[tuple[float, dict[str, Any]], ...] = (
    (0.2, {"sensor_bandwidth": 3e3}),
    (0.2, {"sensor_rate": 1e5, "sensor_bandwidth": 2e4}),
    (0.4, {"actuator_resonance": 8e5, "actuator_damping": 0.3}),
    (0.4, {"amplifier_bandwidth": 2e6}),
    (0.4, {"creep": 0.02}),
    (0.1, {"contacts": 3, "contact_spread": 0.1}),
    (0.1, {"surface_spread": 0.2, "dwell_growth": 0.05}),
    (0.3, {"spring": 1e3}),
)


def axis_by_lot(draw: random.Random) -> Axis:
    """Return an axis with some of the effects."""
    chosen = [values for share, values in EFFECTS if draw.random() < share]
    drawn = {name: value for values in chosen for name, value in values.items()}
    return Axis(Parameters.of({"frequency": 1e3, **drawn}))


def changes(rows: Sequence[Parameter], draw: random.Random) -> dict[str, float]:
    """Return new values of some parameters, anywhere in their range."""
    found = {}
    for row in draw.sample(rows, draw.randint(1, 3)):
        value = draw.choice([row.low, row.high, row.default * 10.0 ** draw.uniform(-2.0, 2.0)])
        found[row.name] = min(max(value, row.low), row.high)
    return found


def command(axis: Axis, commands: RandomCommands, draw: random.Random) -> None:
    """Send the next command; a refusal is fine."""
    name, arguments = commands.next()
    joint = axis.config.joint
    if draw.random() < 0.2:
        value = draw.uniform(-1e-5, 1e-5)
        name, arguments = "joint_command", (joint, draw.choice(["position", "velocity"]), value)
    elif name == "trajectory":
        arguments = [joint], [list(point) for point in arguments[0]]
    elif name == "parameters":
        arguments = (changes(commands.changeable, draw),)
    try:
        if axis.fault:
            axis.command("reset")
        if axis.status.state == "disabled":
            axis.command("enable", True)
        axis.command(name, *arguments)
    except StickslipError:
        pass


def run(seed: int) -> str:
    """Return what went wrong with the axis of a seed, empty if nothing did."""
    draw, commands = random.Random(seed), RandomCommands(seed)
    axis, begun = axis_by_lot(draw), time.process_time()
    try:
        while axis.state.t < LASTS and time.process_time() - begun < TAKES:
            axis.advance(axis.state.t + draw.expovariate(1.0 / PERIOD))
            command(axis, commands, draw)
            axis.take_events()
    except Exception:
        return traceback.format_exc(limit=-3)
    return ""


def commands(axes: int, first: int) -> int:
    """Run axes, from the seed of the first one on; return with how many something went wrong."""
    found = 0
    for seed in range(first, first + axes):
        if said := run(seed):
            found += 1
            print(f"seed {seed}: {said}", flush=True)
    return found
