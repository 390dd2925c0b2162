# SPDX-License-Identifier: Apache-2.0
"""The tasks of the benchmark of control, as data: what is drawn, the target, how it is scored."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

Range = tuple[float, float]

#: How a task is scored -> unit and what it is; the lower the better
SCORES = {
    "arrival": ("s", "time after which the runner stays within the tolerance"),
    "error": ("m", "root mean square of the distance from the target, from a fifth of the time on"),
    "vibration": (
        "m",
        "root mean square of the ringing left by each slip, if all the time within the tolerance",
    ),
}


@dataclass(frozen=True)
class Task:
    """One task. SI units; a pair is a range that each episode draws from, evenly."""

    name: str
    about: str
    score: str  #: one of `SCORES`
    target: Range  #: distance of the target from the start, m; the side is drawn, too
    tolerance: float  #: distance from the target that counts as there, m
    limit: float  #: time of an episode, s
    hold: float = 0.0  #: s within the tolerance that end the episode; 0: it runs to the limit
    speed: float = 0.0  #: m/s at which the target moves away from the start
    parameters: Mapping[str, Any] = field(default_factory=dict)  #: that differ from the defaults
    draws: Mapping[str, Range] = field(default_factory=dict)  #: hidden parameters
    changes: Mapping[str, Range] = field(default_factory=dict)  #: factor on them at the limit


#: A quick interferometer: nanometre noise at 20 kHz, 100 us late
_SENSOR = {
    "sensor_rate": 20e3, "sensor_latency": 1e-4, "sensor_noise": 0.5e-9, "sensor_resolution": 1e-10,
}  # fmt: skip
#: Soft ceramics: the deflection depends on the way of the voltage, and creeps by 2 % a decade
_CERAMICS = {"actuator": "hysteresis", "actuator_memory": True, "creep": 0.02}
#: What differs from drive to drive of one make: preload by a fifth, friction by a quarter
_MAKE = {"preload": (0.32, 0.48), "mu": (0.15, 0.25), "mass": (3.6e-3, 4.4e-3)}

TASKS: Mapping[str, Task] = {
    task.name: task
    for task in (
        Task(
            "long_move", "a long move with hand-over from steps to scan", "arrival",
            target=(20e-6, 60e-6), tolerance=5e-9, limit=0.4, hold=0.01,
            parameters={**_SENSOR, **_CERAMICS}, draws=_MAKE,
        ),
        Task(
            "vertical", "a vertical axis whose load changes on the way", "arrival",
            target=(5e-6, 15e-6), tolerance=5e-9, limit=0.4, hold=0.01,
            parameters={**_SENSOR, "inclination": 0.5 * math.pi},
            draws={**_MAKE, "payload": (0.2e-3, 1e-3)}, changes={"payload": (0.0, 2.0)},
        ),
        Task(
            "quiet", "steps at a given speed with the least ringing", "vibration",
            target=(0.0, 0.0), tolerance=1e-6, limit=0.1, speed=50e-6,
            parameters=_SENSOR, draws=_MAKE,
        ),
        Task(
            "friction", "a move while the friction drifts by up to 30 %", "arrival",
            target=(20e-6, 60e-6), tolerance=5e-9, limit=0.4, hold=0.01,
            parameters=_SENSOR, draws=_MAKE, changes={"mu": (0.7, 1.3)},
        ),
        Task(
            "hold", "holding within 1 nm under creep, drift, noise and a changing force", "error",
            target=(10e-9, 60e-9), tolerance=1e-9, limit=2.0,
            parameters={**_SENSOR, **_CERAMICS, "sensor_rate": 1e3, "sensor_latency": 1e-3},
            draws={
                **_MAKE, "sensor_noise": (0.3e-9, 1e-9), "sensor_drift": (-1e-10, 1e-10),
                "force": (-5e-3, 5e-3),
            },
            changes={"force": (-1.0, 2.0)},
        ),
    )
}  # fmt: skip
