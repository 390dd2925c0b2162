# SPDX-License-Identifier: Apache-2.0
"""How often intervals hold the truth: experiments by lot, from the independent integrator.

    python -m validation.campaigns.intervals [--linear] [--lag] COUNT [FIRST_SEED]

prints each experiment and, at the end, how many intervals of each parameter hold the truth. An
experiment has a contact by lot, one to three traces of 12 cycles with other drives, noise of 0.5 to
3 nm, in half of the traces hum, in half drift, and starting values wrong by up to a factor of 3.
With --lag the amplifier lags by up to 2 us, which no parameters say.
With --linear nothing is searched for: from the Jacobian at the truth follows how far the optimum is
off, in standard deviations. That takes a second, and tells whether the intervals have the right
width and whether what the sensor does pulls at the parameters.
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from dataclasses import dataclass

import numpy as np
from bench_traces import Axis, Drive, Sensor, bench_trace, random_axis

from stickslip_ros.identification import Experiment, Fit, identify
from stickslip_ros.identification.experiment import Stepping
from stickslip_ros.identification.free import free_parameters
from stickslip_ros.identification.least_squares import Problem
from stickslip_ros.identification.profile import Profiler
from stickslip_ros.identification.trace_fit import TraceFit
from stickslip_ros.model import Plant
from stickslip_ros.parameters import Parameters
from stickslip_ros.traces.motion import Motion
from stickslip_ros.traces.ringing import Ringing

#: Rest before the steps, s.
PAUSE = 0.01


@dataclass(frozen=True)
class ScaledAxis(Axis):
    """An axis whose breakaway distance is another than that of Eq. 13."""

    scale: float = 1.0

    @property
    def constants(self) -> tuple[float, float, float, float, float, float]:
        """Mass, sigma_0, sigma_1, z_ba, z_ss, limit of z."""
        mass, sigma_0, sigma_1, z_ba, z_ss, z_limit = super().constants
        return mass, sigma_0, sigma_1, self.scale * z_ba, self.scale * z_ss, z_limit


def lag_of(seed: int) -> float:
    """Return the time constant (s) of the amplifier in an experiment with a lag."""
    return float(np.random.default_rng([seed, 1]).uniform(0.0, 2e-6))


def experiment(
    seed: int, lags: bool = False
) -> tuple[dict[str, float], list[tuple[Parameters, Motion]]]:
    """Return the truth of an experiment, and its traces with what is known of each drive."""
    random = np.random.default_rng(seed)
    lag = lag_of(seed) if lags else 0.0
    count = int(random.integers(1, 4))
    plain = random_axis(random)
    axis = ScaledAxis(
        plain.preload, plain.mass, plain.sigma_1, plain.sigma_0_offset,
        plain.sigma_0ss * float(random.uniform(0.7, 1.5)), float(random.uniform(0.6, 1.8)),
    )  # fmt: skip
    _, sigma_0, sigma_1, z_ba, _, _ = axis.constants
    truth = {"sigma_0": sigma_0, "sigma_1": sigma_1, "z_ba": z_ba, "sigma_0ss": axis.sigma_0ss}
    wrong = np.exp(random.uniform(-np.log(3.0), np.log(3.0), len(truth)))
    start = {name: value * part for (name, value), part in zip(truth.items(), wrong, strict=True)}
    runs = []
    for k in range(count):
        drive = Drive(
            12, float(np.exp(random.uniform(np.log(60.0), np.log(2000.0)))),
            float(random.uniform(150.0, 300.0)), 1, PAUSE, lag,
        )  # fmt: skip
        sensor = Sensor(
            rate=5e5,
            noise=float(random.uniform(0.5e-9, 3e-9)),
            hum=float(random.choice([0.0, random.uniform(2e-9, 15e-9)])),
            drift=float(random.choice([0.0, random.uniform(-2e-7, 2e-7)])),
        )
        bench = bench_trace(axis, (drive,), sensor, 8e-3, seed * 10 + k)
        known = {"preload": axis.preload, "mass": axis.mass, "frequency": drive.frequency,
                 "amplitude": drive.amplitude}  # fmt: skip
        runs.append((Parameters.of({**known, **start}), Motion("bench", bench.t, bench.x)))
    return truth, runs


def judged(truth: dict[str, float], found: Fit) -> dict[str, str]:
    """Return for each parameter: held, missed, or not determined."""
    told = {}
    for name, true in truth.items():
        one = found.parameters[name]
        if not one.determined or one.low is None or one.high is None:
            told[name] = "not determined"
        else:
            told[name] = "held" if one.low <= true <= one.high else "missed"
    return told


def pulls(seed: int, lags: bool = False) -> np.ndarray:
    """Return by how many standard deviations the optimum of an experiment is off the truth, (4,).

    The order is that of the truth; the lag, where there is one, is free and comes last.
    """
    truth, runs = experiment(seed, lags)
    traces = []
    for known, motion in runs:
        true = known.replace(**truth)
        plant = Plant.of(true)
        ringing = Ringing(plant.ringing_frequency, truth["sigma_1"] / (2.0 * plant.mass))
        stepping = Stepping(PAUSE, 12, true.drive.frequency)
        traces.append(TraceFit(Experiment(true, motion, (stepping,), ringing)))
    free = free_parameters([one.parameters for one in traces], list(truth))
    theta = np.log(list(truth.values()))
    if lags:
        free = free.with_lag(lag_of(seed))
        theta = np.append(theta, free.start[-1])
    problem = Problem(traces, free)
    start = problem.begin(theta)
    seen = problem.point(start)
    assert seen is not None
    for trace, one in zip(traces, seen.seen, strict=True):
        trace.learn_noise(one)
    profiler = Profiler(problem, problem.point_of(start, seen.seen))
    step = -np.linalg.lstsq(profiler.jacobian, profiler.best.residuals, rcond=None)[0]
    deviation = np.sqrt(np.diag(np.linalg.inv(profiler.information())))
    return np.asarray(step[: len(theta)] / deviation)


def linear(count: int, first: int, lags: bool) -> None:
    """Print how far the optima of experiments are off, and the root mean squares."""
    found = []
    for seed in range(first, first + count):
        found.append(pulls(seed, lags))
        print(f"{seed}: {', '.join(f'{one:.2f}' for one in found[-1])}", flush=True)
    usual = np.sqrt(np.mean(np.square(found), axis=0))
    within = int(np.sum(np.abs(found) < 1.96))
    print(f"root mean squares {np.round(usual, 2)}; {within} of {np.size(found)} within 1.96")


def main(count: int, first: int, lags: bool) -> None:
    """Run experiments and print what they show."""
    told: dict[str, Counter[str]] = {}
    optima = misfits = 0
    for seed in range(first, first + count):
        truth, runs = experiment(seed, lags)
        begun, clock = time.process_time(), time.monotonic()
        found = identify(runs)
        for name, word in judged(truth, found).items():
            told.setdefault(name, Counter())[word] += 1
        parts = {name: found.parameters[name].value / true for name, true in truth.items()}
        # Another optimum has another stiffness or damping, which every trace tells well.
        optimum = abs(parts["sigma_0"] - 1.0) < 0.02 and abs(parts["sigma_1"] - 1.0) < 0.3
        optima += optimum
        misfits += found.misfit is not None
        values = ", ".join(f"{name} {part:.4f}" for name, part in parts.items())
        took, wall = time.process_time() - begun, time.monotonic() - clock
        words = f"{judged(truth, found)}{', MISFIT' if found.misfit else ''}"
        print(
            f"{seed}: {len(runs)} traces, {took:.0f} s of CPU, {wall:.0f} s, {values}, {words}",
            flush=True,
        )
    for name, counts in told.items():
        sure = counts["held"] + counts["missed"]
        print(f"{name}: {counts['held']} of {sure} intervals hold the truth, determined {sure}")
    print(f"the global optimum in {optima} of {count}; misfit told in {misfits}")


if __name__ == "__main__":
    numbers = [int(one) for one in sys.argv[1:] if not one.startswith("--")]
    given = numbers[0], numbers[1] if len(numbers) > 1 else 1000
    (linear if "--linear" in sys.argv else main)(*given, lags="--lag" in sys.argv)
