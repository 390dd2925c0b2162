# SPDX-License-Identifier: Apache-2.0
"""Traces of the kinds that benches make, and what is true of each.

The motion is that of `bench_traces`, integrated apart from the package. Amplitude, frequency and
preload are drawn evenly in their logarithms. Each kind adds one thing that measurements have: no
rest, few samples, a sweep, jumps of an interferometer, creep, ...
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from bench_traces import GAIN, Axis, Drive, Sensor, TrueRun, bench_trace, pink, random_bench
from numpy.typing import NDArray

Array = NDArray[np.float64]
Made = tuple[Array, Array, list[TrueRun]]

#: Length of a fringe of the interferometer whose jumps are made, m: half of 633 nm.
FRINGE = 316.4e-9
#: Samples of a trace at most, as they take time.
_MOST = 100_000


@dataclass(frozen=True)
class LabTrace:
    """A trace and what is true of it."""

    kind: str
    seed: int
    t: Array  #: s
    x: Array  #: m
    runs: tuple[TrueRun, ...]
    frequency: float  #: of the first drive, Hz
    axis: Axis
    knowable: bool  #: whether it rests, has 10 samples a cycle, 3 cycles, and an even clock


@dataclass(frozen=True)
class Plan:
    """An ordinary measurement that a kind changes."""

    axis: Axis
    drive: Drive
    sensor: Sensor
    random: np.random.Generator

    def evenly(self, low: float, high: float) -> float:
        """Return a number evenly from low to high."""
        return float(self.random.uniform(low, high))

    def scaled(self, low: float, high: float) -> float:
        """Return a number evenly in its logarithm from low to high."""
        return math.exp(self.evenly(math.log(low), math.log(high)))

    def driven(self, **changes: Any) -> Plan:
        """Return the plan with another drive; rests and sampling follow its frequency."""
        drive = replace(self.drive, **changes)
        if "frequency" in changes:
            drive = replace(drive, pause=self.evenly(1.5, 5.0) / drive.frequency)
        total = drive.cycles / drive.frequency + 2.0 * drive.pause
        rate = min(max(self.sensor.rate, 12.0 * drive.frequency), _MOST / total)
        return replace(self, drive=drive, sensor=replace(self.sensor, rate=rate))

    def sensed(self, **changes: Any) -> Plan:
        """Return the plan with another sensor."""
        return replace(self, sensor=replace(self.sensor, **changes))


def _plan(random: np.random.Generator) -> Plan:
    """Return an axis that steps, and its drive."""
    plan = Plan(Axis(), Drive(1), Sensor(), random)
    axis = Axis(
        plan.scaled(0.1, 2.0), plan.scaled(2e-3, 2e-2), plan.evenly(3.0, 15.0),
        plan.evenly(4e6, 9e6), plan.evenly(0.7e7, 1.5e7),
    )  # fmt: skip
    drive = Drive(
        cycles=int(random.integers(10, 31)),
        amplitude=plan.scaled(80.0, 300.0),
        direction=int(random.choice([-1, 1])),
    )
    noise = plan.scaled(0.3e-9, 4e-9)
    plan = Plan(axis, drive, Sensor(float(random.choice([5e4, 1e5, 2e5])), noise), random)
    plan = plan.driven(frequency=plan.scaled(20.0, min(3e3, 0.3 * axis.ringing[0])))
    return plan if _steps(plan) else _plan(random)


def _steps(plan: Plan) -> bool:
    """Return whether the axis gets forward as stick-slip axes do, and not in the first steps only.

    Of a runner that swings on the spot, no record tells the steps.
    """
    size = abs(_made(plan.driven(cycles=15), quiet=True)[2][0].step_size)
    reach = GAIN * plan.drive.amplitude
    return max(6.0 * plan.sensor.noise, 0.1 * reach) < size < reach


def _made(plan: Plan, drives: tuple[Drive, ...] | None = None, quiet: bool = False) -> Made:
    rest = max(plan.evenly(1.5, 5.0) / plan.drive.frequency, 2e-3)
    sensor = Sensor(rate=1e4) if quiet else plan.sensor
    seed = int(plan.random.integers(2**31))
    bench = bench_trace(plan.axis, drives or (plan.drive,), sensor, rest, seed)
    return bench.t, bench.x.copy(), bench.runs


def _both_ways(plan: Plan) -> Made:
    back = replace(
        plan.drive, direction=-plan.drive.direction, cycles=int(plan.random.integers(5, 20))
    )
    return _made(plan, (plan.drive, back))


def _cut(begin: bool, end: bool) -> Callable[[Plan], Made]:
    def make(plan: Plan) -> Made:
        t, x, (run,) = _made(plan)
        period = 1.0 / run.frequency
        first = run.start + 2.3 * period if begin else -math.inf
        last = run.end - 2.7 * period if end else math.inf
        kept = (t > first) & (t < last)
        # The cycle that the record begins in counts, since its slip is seen.
        return t[kept], x[kept], [replace(run, steps=run.steps - 2 * begin - 3 * end)]

    return make


def _part_cycle(plan: Plan) -> Made:
    """The drive stops within a cycle and holds: a rise without a slip is no step."""
    t, x, (run,) = _made(plan)
    whole = run.end - 1.0 / run.frequency
    kept = t < whole + plan.evenly(0.3, 0.8) / run.frequency
    at = np.flatnonzero(kept)[-1]
    held = np.where(kept, x, x[at])
    held[~kept] += plan.sensor.noise * plan.random.standard_normal(int((~kept).sum()))
    return t, held, [replace(run, end=whole, steps=run.steps - 1)]


def _samples_a_cycle(low: float, high: float) -> Callable[[Plan], Made]:
    def make(plan: Plan) -> Made:
        plan = plan.driven(cycles=int(plan.random.integers(20, 80)))
        return _made(plan.sensed(rate=plan.evenly(low, high) * plan.drive.frequency))

    return make


def _samples_a_swing(low: float, high: float) -> Callable[[Plan], Made]:
    def make(plan: Plan) -> Made:
        rate = plan.evenly(low, high) * plan.axis.ringing[0]
        return _made(
            plan.driven(frequency=min(plan.drive.frequency, rate / 15.0)).sensed(rate=rate)
        )

    return make


def _sweep(plan: Plan) -> Made:
    """Every cycle has a frequency of its own, up or down to a factor of 1.5 over the run."""
    factor = plan.evenly(1.1, 1.5) ** (plan.random.choice([-1, 1]) / plan.drive.cycles)
    drives = tuple(
        replace(plan.drive, cycles=1, frequency=plan.drive.frequency * factor**k,
                pause=plan.drive.pause if k == 0 else 0.0)
        for k in range(plan.drive.cycles)
    )  # fmt: skip
    t, x, runs = _made(plan, drives)
    late = runs[len(runs) // 2 :]
    return t, x, [replace(runs[0], end=runs[-1].end, steps=len(runs),
                          step_size=float(np.mean([run.step_size for run in late])),
                          backstep=float(np.mean([run.backstep for run in late])))]  # fmt: skip


def _fringe_jumps(plan: Plan) -> Made:
    t, x, runs = _made(plan)
    for at in plan.random.choice(len(t), int(plan.random.integers(1, 6)), replace=False):
        x[at:] += FRINGE * plan.random.choice([-1.0, 1.0])
    return t, x, runs


def _spikes(plan: Plan) -> Made:
    t, x, runs = _made(plan)
    at = plan.random.choice(len(t), max(3, len(t) // 500), replace=False)
    x[at] += plan.random.uniform(-3e-6, 3e-6, len(at))
    return t, x, runs


def _clipping(plan: Plan) -> Made:
    """The converter ends within the run."""
    t, x, (run,) = _made(plan)
    end = np.interp(run.end - plan.evenly(0.1, 0.4) * (run.end - run.start), t, x)
    cut = np.minimum(x, end) if run.direction > 0 else np.maximum(x, end)
    return t, cut, [replace(run, steps=0)]


def _added(shape: Callable[[Plan, Array, TrueRun], Array]) -> Callable[[Plan], Made]:
    def make(plan: Plan) -> Made:
        t, x, runs = _made(plan)
        return t, x + shape(plan, t, runs[0]), runs

    return make


def _polynomial(plan: Plan, t: Array, run: TrueRun) -> Array:
    place = 2.0 * t / t[-1] - 1.0
    each = plan.random.standard_normal(3)
    size = plan.evenly(0.05, 0.3) * abs(run.step_size)
    return np.asarray(size * np.polynomial.chebyshev.chebval(place, [0.0, *each]))


def _walk(plan: Plan, t: Array, run: TrueRun) -> Array:
    walk = np.cumsum(plan.random.standard_normal(len(t))) / math.sqrt(len(t))
    return np.asarray(plan.evenly(0.1, 0.6) * abs(run.step_size) * walk)


def _pink(plan: Plan, t: Array, run: TrueRun) -> Array:
    noise = pink(plan.random, len(t))
    return np.asarray(plan.evenly(0.02, 0.08) * abs(run.step_size) * noise / np.std(noise))


def _white(plan: Plan, t: Array, run: TrueRun) -> Array:
    return plan.evenly(0.1, 0.5) * abs(run.step_size) * plan.random.standard_normal(len(t))


def _creep(plan: Plan, t: Array, run: TrueRun) -> Array:
    """The runner creeps on in the direction of the steps, with the logarithm of time."""
    since = np.maximum(t - run.start, 0.0)
    return plan.evenly(0.02, 0.06) * run.step_size * np.log1p(since * run.frequency)


def _hum(low: float, high: float) -> Callable[[Plan], Made]:
    """Return what makes hum of such parts of a step at 20 kS/s."""

    def make(plan: Plan) -> Made:
        plan = plan.driven(frequency=min(plan.drive.frequency, 1e3)).sensed(rate=2e4)
        size = abs(_made(plan.driven(cycles=4), quiet=True)[2][0].step_size)
        mains = float(plan.random.choice([50.0, 60.0]))
        return _made(plan.sensed(hum=plan.evenly(low, high) * size, mains=mains))

    return make


def _tiny(plan: Plan) -> Made:
    """Steps of 5 to 10 nm, by a smaller amplitude."""
    for amplitude in np.geomspace(plan.drive.amplitude, 20.0, 40):
        trial = plan.driven(amplitude=float(amplitude))
        size = abs(_made(trial.driven(cycles=10), quiet=True)[2][0].step_size)
        if 5e-9 < size < 10e-9:
            return _made(trial.sensed(noise=plan.evenly(0.2e-9, 1e-9)))
    return _tiny(_plan(plan.random))


def _nothing(plan: Plan) -> Made:
    """Noise, drift, hum, or a plain sine: no step."""
    t, x, _ = _made(plan)
    x = plan.sensor.noise * plan.random.standard_normal(len(t)) + plan.random.uniform(0, 1e-7) * t
    x += plan.random.choice([0.0, 1e-8]) * np.sin(2.0 * np.pi * 50.0 * t)
    x += plan.random.choice([0.0, 5e-8]) * np.sin(2.0 * np.pi * plan.drive.frequency * t)
    return t, x, []


def _cycles(low: int, high: int) -> Callable[[Plan], Made]:
    return lambda plan: _made(plan.driven(cycles=int(plan.random.integers(low, high + 1))))


def _long(plan: Plan) -> Made:
    plan = plan.driven(cycles=700, frequency=plan.scaled(100.0, 1e3))
    return _made(plan) if _steps(plan) else _long(_plan(plan.random))


def _slow(plan: Plan) -> Made:
    """Cycles of tenths of a second, with hum and drift."""
    plan = plan.driven(frequency=plan.scaled(0.5, 5.0), cycles=6)
    hum = float(plan.random.choice([0.0, 5e-9]))
    return _made(plan.sensed(rate=2e4, hum=hum, drift=plan.evenly(-5e-9, 5e-9)))


def _two_amplitudes(plan: Plan) -> Made:
    weaker = replace(plan.drive, amplitude=0.8 * plan.drive.amplitude, cycles=12)
    if not _steps(replace(plan, drive=weaker)):
        return _two_amplitudes(_plan(plan.random))
    return _made(plan, (plan.drive, weaker))


#: Kinds by name; True: rests, 10 samples a cycle, an even clock, so it can be known.
KINDS: dict[str, tuple[Callable[[Plan], Made], bool]] = {
    "plain": (_made, True),
    "both ways": (_both_ways, True),
    "two amplitudes": (_two_amplitudes, True),
    "no rest before": (_cut(True, False), True),
    "no rest after": (_cut(False, True), True),
    "no rest": (_cut(True, True), False),
    "part of a last cycle": (_part_cycle, True),
    "3 to 5 samples a cycle": (_samples_a_cycle(3.0, 5.0), False),
    "5 to 9 samples a cycle": (_samples_a_cycle(5.0, 9.0), False),
    "10 to 14 samples a cycle": (_samples_a_cycle(10.0, 14.0), True),
    "1.5 to 3 samples a swing": (_samples_a_swing(1.5, 3.0), True),
    "3 to 6 samples a swing": (_samples_a_swing(3.0, 6.0), True),
    "sweep": (_sweep, False),
    "fringe jumps": (_fringe_jumps, False),
    "spikes": (_spikes, True),
    "gaps": (lambda plan: _made(plan.sensed(dropouts=4)), True),
    "clipping": (_clipping, False),
    "hum": (_hum(0.02, 0.2), True),
    "strong hum": (_hum(0.3, 1.0), False),
    "polynomial drift": (_added(_polynomial), True),
    "random walk": (_added(_walk), True),
    "creep": (_added(_creep), True),
    "pink noise": (_added(_pink), True),
    "white noise": (_added(_white), True),
    "1 to 2 cycles": (_cycles(1, 2), False),
    "3 to 5 cycles": (_cycles(3, 5), True),
    "700 cycles": (_long, True),
    "tiny steps": (_tiny, True),
    "slow": (_slow, True),
    "jitter": (lambda plan: _made(plan.sensed(jitter=0.5, quantum=2e-9)), True),
    "nothing": (_nothing, True),
}
#: Up to three runs, of other drives perhaps, with several disturbances: a kind for itself.
AT_RANDOM = "at random"


def lab_trace(kind: str, seed: int) -> LabTrace:
    """Return the trace of a kind; the same seed gives the same trace."""
    if kind == AT_RANDOM:  # of another axis in every trace
        bench = random_bench(seed)
        first, every = bench.runs[0].frequency, tuple(bench.runs)
        samples = bench.sensor.rate / max(one.frequency for one in every)
        knowable = min(one.steps for one in every) >= 3 and samples >= 10.0
        return LabTrace(kind, seed, bench.t, bench.x, every, first, bench.axis, knowable)
    make, knowable = KINDS[kind]
    plan = _plan(np.random.default_rng([list(KINDS).index(kind), seed]))
    t, x, runs = make(plan)
    frequency = runs[0].frequency if runs else plan.drive.frequency
    return LabTrace(kind, seed, t, x, tuple(runs), frequency, plan.axis, knowable)
