# SPDX-License-Identifier: Apache-2.0
"""The tasks of the benchmark of control: what is drawn, targets, rewards, scores."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.arrays import Array
from stickslip_ros.gym.axis_batch import AxisBatch, DriveRanges
from stickslip_ros.library.ensemble import Ensemble, read_ensemble
from stickslip_ros.parameters import ParameterError, Parameters, ParameterSource

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
#: Soft ceramics: the deflection depends on the path of the voltage, and creeps by 2 % a decade
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

#: Parts of an episode after each of which the parameters that change are set anew
_STAGES = 50
#: Share of an episode after which errors and ringing count for the score
_SETTLED = 0.2
#: Seeds are below this
_SEEDS = 2**31


@dataclass(frozen=True)
class Weights:
    """What the reward takes away, each for a unit of it."""

    time: float = 1.0  #: 1/s
    error: float = 0.0  #: for the distance from the target, over time, 1/(m s)
    approach: float = 1e4  #: given back for each metre that the runner comes nearer, 1/m
    overshoot: float = 0.0  #: for each metre farther beyond the target than before, 1/m
    vibration: float = 0.0  #: for the ringing left by a period, over time, 1/(m s)
    energy: float = 0.0  #: for the heat of the contact, 1/J
    wear: float = 0.0  #: for the distance that the contact slides, 1/m


class PeriodResult(NamedTuple):
    """What a period came to, arrays of shape (axes,)."""

    reward: Array
    terminated: NDArray[np.bool_]  #: within the tolerance for the time asked for
    truncated: NDArray[np.bool_]  #: at the limit of time


class Positioning:
    """Axes that do a task; each has a generator of its own, from which its episodes are drawn."""

    def __init__(
        self,
        count: int,
        task: str | Task = "long_move",
        parameters: ParameterSource = None,
        ranges: DriveRanges | None = None,
        randomise: Mapping[str, tuple[float, float]] | Ensemble | Path | str | None = None,
        weights: Weights | None = None,
    ) -> None:
        """Set up the axes; the arguments are those of the environments. ParameterError."""
        if isinstance(task, str) and task not in TASKS:
            raise ParameterError(f"task is {task!r}; known: {', '.join(TASKS)}")
        self.task = TASKS[task] if isinstance(task, str) else task
        p = Parameters.of(parameters).replace(**self.task.parameters)
        self.weights = weights or Weights()
        self.axes = AxisBatch(p, count, ranges or DriveRanges())
        found = read_ensemble(Path(randomise)) if isinstance(randomise, str | Path) else randomise
        self._ensemble = found if isinstance(found, Ensemble) else None
        given = found if isinstance(found, Mapping) else {}
        self._draws = {**self.task.draws, **given} if self._ensemble is None else self.task.draws
        drawn: dict[str, Sequence[float]] = dict(self._draws)
        if self._ensemble:
            ends = zip(self._ensemble.low, self._ensemble.high, strict=True)
            drawn |= dict(zip(self._ensemble.names, ends, strict=True))
        for name, values in drawn.items():
            self.axes.check_varied(name, values)
        #: Hidden parameters of the running episodes, by name, (axes,)
        self.hidden = {name: np.zeros(count) for name in drawn}
        missing = set(self.task.changes) - set(self.hidden)
        if missing:
            raise ParameterError(f"{', '.join(missing)} changes, but is not drawn: give its range")
        self.factors = {name: np.ones(count) for name in self.task.changes}
        self._stage = np.zeros(count, np.int64)
        self.goal = np.zeros(count)  #: target at the start, m
        self.side = np.ones(count)  #: of the start on which it lies: 1 or -1
        self._beyond, self._away = np.zeros(count), np.zeros(count)  # farthest, and last, m
        self.inside_since = np.zeros(count)  #: s, within the tolerance since; inf: it is not
        self._sums = np.zeros((count, 3))  # time (s), its error^2 (m^2 s), its vibration^2 (m^2 s)

    def start(self, which: NDArray[np.int64], generators: list[np.random.Generator]) -> None:
        """Draw and begin episodes of the axes ``which``, (some,), one generator for each."""
        seeds = np.zeros(len(which), np.int64)
        for place, (k, generator) in enumerate(zip(which.tolist(), generators, strict=True)):
            for name, (low, high) in self._draws.items():
                self.hidden[name][k] = generator.uniform(low, high)
            if self._ensemble:
                drawn = self._ensemble.draw(1, int(generator.integers(_SEEDS)))
                for name, value in drawn.items():
                    self.hidden[name][k] = value[0]
            for name, (low, high) in self.task.changes.items():
                self.factors[name][k] = generator.uniform(low, high)
            self.side[k] = 1.0 if generator.random() < 0.5 else -1.0
            self.goal[k] = self.side[k] * generator.uniform(*self.task.target)
            seeds[place] = generator.integers(_SEEDS)
        columns = {name: values[which] for name, values in self.hidden.items()}
        self.axes.start(which, columns, seeds)
        self._stage[which], self._beyond[which], self._sums[which] = 0, 0.0, 0.0
        self._away[which] = np.abs(self.goal[which])
        self.inside_since[which] = math.inf

    @property
    def target(self) -> Array:
        """The present target, m, (axes,)."""
        return self.goal + self.side * self.task.speed * self.axes.states.t

    @property
    def observation(self) -> Array:
        """Reading (m), target (m), voltage (V) and time (s), (axes, 4)."""
        states = self.axes.states
        return np.stack([states.reading, self.target, states.level, states.t], axis=1)

    def run(self, actions: Array) -> PeriodResult:
        """Run a period with actions, (axes, numbers), -1 to 1."""
        states, task, w = self.axes.states, self.task, self.weights
        before = states.t.copy()
        self.axes.run(actions)
        dt, error = states.t - before, states.x - self.target
        away, beyond = np.abs(error), error * self.side
        farther = np.maximum(beyond - self._beyond, 0.0)
        cost = w.time * dt + w.error * away * dt + w.approach * (away - self._away)
        cost += w.overshoot * farther + w.vibration * states.vibration * dt
        cost += w.energy * states.lost + w.wear * states.slid
        self._beyond, self._away = self._beyond + farther, away
        inside = away <= task.tolerance
        since = np.minimum(self.inside_since, states.t)
        self.inside_since = np.where(inside, since, math.inf)
        late = np.where(states.t >= _SETTLED * task.limit, dt, 0.0)
        self._sums += np.stack([late, late * error**2, late * states.vibration**2], axis=1)
        held = inside & (states.t - since >= task.hold) & (task.hold > 0.0)
        outcome = PeriodResult(-cost, held, ~held & (states.t >= task.limit))
        self._change()
        return outcome

    def _change(self) -> None:
        """Set the parameters that change, where the next stage has begun."""
        if not self.factors:
            return
        states = self.axes.states
        stage = np.minimum((_STAGES * states.t / self.task.limit).astype(np.int64), _STAGES)
        which = np.flatnonzero(stage != self._stage)
        self._stage[which] = stage[which]
        if len(which):
            columns = {name: values[which] for name, values in self.hidden.items()}
            for name, factors in self.factors.items():
                columns[name] = columns[name] * (
                    1.0 + (factors[which] - 1.0) * (stage[which] / _STAGES)
                )
            self.axes.change(which, columns)

    @property
    def score(self) -> Array:
        """The score of the episodes as they stand, (axes,), the lower the better; see `SCORES`.

        inf where the task is not done.
        """
        if self.task.score == "arrival":
            return self.inside_since.copy()
        time, error, vibration = self._sums.T
        squares = error if self.task.score == "error" else vibration
        mean = np.sqrt(squares / np.maximum(time, np.finfo(float).tiny))
        known = time > 0.0
        if self.task.score == "vibration":
            known &= self.inside_since <= _SETTLED * self.task.limit
        return np.where(known, mean, math.inf)

    def info(self) -> dict[str, Array]:
        """Return what a policy does not see, by name, each (axes,); SI units."""
        states = self.axes.states
        return {
            "position": states.x.copy(), "error": states.x - self.target,
            "overshoot": self._beyond.copy(), "vibration": states.vibration.copy(),
            "energy": states.lost.copy(), "wear": states.slid.copy(), "score": self.score,
        }  # fmt: skip
