# SPDX-License-Identifier: Apache-2.0
"""An axis whose parameters change at random, at any cost: it hears every stop and every signal.

One peer changes parameters and amplitude of a moving axis, however much they cost, and stops it
after each change. After twenty sets the axis is ended by a signal, and begins anew. Each stop has
to be answered, and each signal to end the process, within 0.2 s; the status has to name an overload
where time was dropped, and the process may not grow. The time for which node and peer waited for
nothing but a processor is taken off, so a busy machine counts as an idle one.
"""

from __future__ import annotations

import math
import os
import signal
import tempfile
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from stickslip_ros.base.child_process import choose_domain
from stickslip_ros.ros.client import AxisClient, CommandRefused
from stickslip_ros.simulation import warm_up
from validation.campaigns.processes import PATIENCE, Program, memory_of, waited, waited_here
from validation.draws import even

HEARD = 0.2  #: s at most to an answer, or from a signal to the end
#: What an axis may have from its start, and what changes while it runs; all of it may cost
AT_START = {
    "contacts": (1, 16),
    "contact_spread": (0.0, 0.3),
    "frequency": (1.0, 2e4),
    "creep": (0.0, 0.05),
    "surface_spread": (0.0, 0.3),
    "dwell_growth": (0.0, 0.1),
    "sensor_rate": (1e2, 1e5),
    "publish_rate": (10.0, 1e3),
}
CHANGED = {
    "sensor_bandwidth": (0.0, 3e4),
    "preload": (0.05, 5.0),
    "sigma_1": (0.01, 100.0),
    "mass": (1e-4, 0.1),
    "spring": (0.0, 1e5),
    "tolerance": (1e-13, 1e-10),
    "sensor_noise_corner": (0.0, 1e4),
    "sensor_order": (1, 2),
}
SETS_OF_AN_AXIS = 20
#: MB that an axis may grow by in the second half of its sets: what DDS holds for late readers
GROWTH = 10.0


@dataclass
class Heard:
    """What a campaign saw."""

    stops: list[float] = field(default_factory=list)  #: s to each answer
    ends: list[float] = field(default_factory=list)  #: s from each signal to the end
    growth: list[float] = field(default_factory=list)  #: MB, of each axis
    refused: int = 0  #: sets
    overloaded: int = 0  #: sets whose status named an overload
    faults: list[str] = field(default_factory=list)


def drawn(lot: np.random.Generator, ranges: Mapping[str, tuple[float, float]]) -> dict[str, Any]:
    """Return some parameters, evenly in their range or in its logarithm."""
    values: dict[str, Any] = {}
    for name in lot.choice(sorted(ranges), lot.integers(1, 5), replace=False).tolist():
        low, high = ranges[name]
        if isinstance(low, int):
            values[name] = int(lot.integers(low, int(high) + 1))
        else:
            values[name] = even(lot, low, high) if low > 0.0 else float(lot.uniform(low, high))
    return values


def an_axis(lot: np.random.Generator, sets: int, heard: Heard, folder: Path) -> None:
    """Let one axis live through so many sets, and end it by a signal."""
    words = ["axis_node", "--ros-args", "-p", "slewrate:=50.0", "-p", "max_frequency:=25000.0"]
    for name, value in drawn(lot, AT_START).items():
        words += ["-p", f"{name}:={value}"]
    process = Program(folder, *words)
    try:
        with AxisClient(timeout=PATIENCE) as client:
            memory = []
            for _ in range(sets):
                _one_set(lot, client, process.pid, heard)
                memory.append(memory_of(process.pid))
            heard.growth.append(memory[-1] - memory[len(memory) // 2])
            with suppress(CommandRefused):  # in a fault of the last set
                client.send("jog", 1000.0)
            ending = signal.SIGINT if lot.random() < 0.5 else signal.SIGTERM
            heard.ends.append(process.signalled(ending))
        heard.faults += [f"after {ending.name}: {fault}" for fault in process.faults(0)]
    except TimeoutError as error:
        heard.faults.append(f"{error}; it said: {process.said[-2000:]}")
    finally:
        process.end()


def _one_set(lot: np.random.Generator, client: AxisClient, pid: int, heard: Heard) -> None:
    """Change parameters, jog, and measure the answer to a stop."""
    values = drawn(lot, CHANGED)
    try:
        client.set_parameters(**values)
        client.send("jog", float(f"{10.0 ** lot.uniform(1.0, 4.3):.3g}"))
    except CommandRefused:
        heard.refused += 1
    time.sleep(lot.uniform(0.0, 2.5))
    for _ in range(2):  # a machine that stood still a moment ago is known as that a second later
        report = client.report()
        factor, said = float(report["timing"]["real-time factor"]), report["axis"]["overload"]
        if said or factor > 0.5:
            break
    else:
        heard.faults.append(f"real-time factor {factor:g} without a word: {values}")
    heard.overloaded += bool(said)
    before, begin = waited(pid) + waited_here(), time.monotonic()
    client.send("stop")
    took = time.monotonic() - begin - (waited(pid) + waited_here() - before)
    heard.stops.append(took)
    if took > HEARD:
        heard.faults.append(f"stop answered after {took:.3f} s: {values}")


def study(sets: int, seed: int) -> Heard:
    """Try so many sets; return what was heard."""
    choose_domain()
    warm_up()
    heard, lot = Heard(), np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as folder:
        for first in range(0, sets, SETS_OF_AN_AXIS):
            an_axis(lot, min(SETS_OF_AN_AXIS, sets - first), heard, Path(folder))
    heard.faults += [f"ended {took:.3f} s after a signal" for took in heard.ends if took > HEARD]
    heard.faults += [f"grew by {size:.0f} MB" for size in heard.growth if size > GROWTH]
    return heard


def overload(sets: int, seed: int) -> int:
    """Print what was heard; return how many faults."""
    heard = study(sets, seed)
    print(*heard.faults, sep="\n")
    most = partial(max, default=math.nan)  # where an axis was silent, there is none
    print(
        f"{len(heard.stops)} sets ({heard.refused} refused, {heard.overloaded} overloaded): stops "
        f"answered within {most(heard.stops):.3f} s (median {median(heard.stops or [math.nan]):.3f}"
        f"), {len(heard.ends)} signals within {most(heard.ends):.3f} s, growth at most "
        f"{most(heard.growth):.1f} MB, load {os.getloadavg()[0]:.1f}"
    )
    return len(heard.faults)
