# SPDX-License-Identifier: Apache-2.0
"""How often intervals hold the truth: random experiments, from the independent integrator.

    python -m validation.campaigns.intervals [--linear] COUNT [FIRST_SEED] >> FILE
    python -m validation.campaigns.intervals --sum FILE

The first prints a line of JSON for each experiment, the second counts those of a file: how many
intervals of each parameter hold the truth, with the binomial standard error, how wide they are,
and what the misfits say.

An experiment has a random contact and one or two traces of 12 cycles with other drives. The noise
is white, pink or white and a random walk; the amplifier lags by 0 to 2 us; in half of the traces
each there are hum, drift and creep. Starting values are wrong by up to a factor of 3. The width is
compared with that of a fit which knows the lag, hum, drift, creep and the colour of the noise; it
follows from the Jacobian at the truth.
With --linear nothing is searched for: from the Jacobian at the truth follows how far the optimum is
off, in standard deviations. That takes a second, and tells whether the intervals have the right
width and whether what the sensor does pulls at the parameters.
"""

from __future__ import annotations

import json
import math
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from bench_traces import Array, Axis, Drive, Sensor, bench_trace, random_axis

from stickslip_ros.identification import Experiment, Fit, IdentificationError, identify
from stickslip_ros.identification.experiment import Stepping
from stickslip_ros.identification.free import FreeParameters, free_parameters
from stickslip_ros.identification.least_squares import Problem
from stickslip_ros.identification.profile import Profiler
from stickslip_ros.identification.trace_fit import BinnedModel, TraceFit
from stickslip_ros.measurement.steps.ringing import Ringing
from stickslip_ros.model import Plant
from stickslip_ros.motion.motion import Motion
from stickslip_ros.parameters import Parameters
from stickslip_ros.reporting import CONFIDENCE
from validation.campaigns.arguments import arguments

#: Rest before the steps, s; steps; samples in a second.
PAUSE, STEPS, RATE = 0.01, 12, 5e5
NOISES = ("white", "pink", "walk")


@dataclass(frozen=True)
class ScaledAxis(Axis):
    """An axis whose breakaway distance is another than that of Eq. 13."""

    scale: float = 1.0

    @property
    def constants(self) -> tuple[float, float, float, float, float, float]:
        """Mass, sigma_0, sigma_1, z_ba, z_ss, limit of z."""
        mass, sigma_0, sigma_1, z_ba, z_ss, z_limit = super().constants
        return mass, sigma_0, sigma_1, self.scale * z_ba, self.scale * z_ss, z_limit


@dataclass(frozen=True)
class Trace:
    """One trace of an experiment."""

    known: Parameters  #: what the file says of the drive
    t: Array  #: s
    x: Array  #: as measured, m
    quiet: Array  #: without hum, drift and creep, m


@dataclass(frozen=True)
class Drawn:
    """A random experiment."""

    truth: dict[str, float]
    lag: float  #: s
    noise: str
    traces: list[Trace]


def _coloured(random: np.random.Generator, kind: str, count: int) -> Array:
    """Return noise of a kind (m), (count,)."""
    noise = random.uniform(0.5e-9, 3e-9) * random.standard_normal(count)
    if kind == "pink":
        spectrum = np.fft.rfft(random.standard_normal(count))
        spectrum[1:] /= np.sqrt(np.arange(1, len(spectrum)))
        pink = np.fft.irfft(spectrum, count)
        noise = random.uniform(1e-9, 4e-9) * pink / np.std(pink)
    if kind == "walk":
        walk = np.cumsum(random.standard_normal(count)) / math.sqrt(count)
        noise += random.uniform(2e-9, 3e-8) * walk
    return np.asarray(noise)


def draw(seed: int) -> Drawn:
    """Return an experiment."""
    random = np.random.default_rng(seed)
    kind, lag = str(random.choice(NOISES)), float(random.uniform(0.0, 2e-6))
    plain = random_axis(random)
    axis = ScaledAxis(
        plain.preload, plain.mass, plain.sigma_1, plain.sigma_0_offset,
        plain.sigma_0ss * float(random.uniform(0.7, 1.5)), float(random.uniform(0.6, 1.8)),
    )  # fmt: skip
    _, sigma_0, sigma_1, z_ba, _, _ = axis.constants
    truth = {"sigma_0": sigma_0, "sigma_1": sigma_1, "z_ba": z_ba, "sigma_0ss": axis.sigma_0ss}
    wrong = np.exp(random.uniform(-np.log(3.0), np.log(3.0), len(truth)))
    start = {name: value * part for (name, value), part in zip(truth.items(), wrong, strict=True)}
    traces = []
    for k in range(int(random.integers(1, 3))):
        drive = Drive(
            STEPS, float(np.exp(random.uniform(np.log(100.0), np.log(2000.0)))),
            float(random.uniform(150.0, 300.0)), 1, PAUSE, lag,
        )  # fmt: skip
        sensor = Sensor(
            rate=RATE,
            hum=float(random.choice([0.0, random.uniform(2e-9, 15e-9)])),
            mains=float(random.choice([50.0, 60.0])),
            drift=float(random.choice([0.0, random.uniform(-2e-7, 2e-7)])),
        )
        bench = bench_trace(axis, (drive,), sensor, 8e-3, seed * 10 + k)
        noise = _coloured(random, kind, len(bench.t))
        since = np.maximum(bench.t - PAUSE, 0.0) * drive.frequency
        creep = random.choice([0.0, random.uniform(0.01, 0.05)]) * bench.runs[0].step_size
        known = {"preload": axis.preload, "mass": axis.mass, "frequency": drive.frequency,
                 "amplitude": drive.amplitude}  # fmt: skip
        x = bench.x + creep * np.log1p(since) + noise
        traces.append(Trace(Parameters.of({**known, **start}), bench.t, x, bench.clean + noise))
    return Drawn(truth, lag, kind, traces)


class _Levelled(TraceFit):
    """A trace of which only the zero is unknown, and hum while noise is taken for it."""

    def columns(self) -> Array:
        """Return all columns but that of the drift."""
        return super().columns()[:, :-1]

    def learn_noise(self, seen: BinnedModel) -> None:
        """Learn the noise, without the hum, of which there is none."""
        super().learn_noise(seen)
        self.hum = None


def _at_truth(drawn: Drawn, knows: bool) -> Profiler:
    """Return the profiler at the truth, of a fit that knows all effects or none."""
    truth, kind = drawn.truth, _Levelled if knows else TraceFit
    bandwidth = 1.0 / (2.0 * math.pi * max(drawn.lag, 1e-9))
    traces = []
    for one in drawn.traces:
        true = one.known.replace(**truth)
        plant = Plant.of(true)
        ringing = Ringing(plant.ringing_frequency, truth["sigma_1"] / (2.0 * plant.mass))
        if knows:
            true = true.replace(amplifier_bandwidth=bandwidth)
        motion = Motion("bench", one.t, one.quiet if knows else one.x)
        stepping = Stepping(PAUSE, STEPS, true.drive.frequency)
        traces.append(kind(Experiment(true, motion, (stepping,), ringing)))
    free: FreeParameters = free_parameters([one.parameters for one in traces], list(truth))
    theta = np.log(list(truth.values()))
    if not knows:
        free = free.with_lag(max(drawn.lag, 1e-9))
        theta = np.append(theta, free.start[-1])
    problem = Problem(traces, free)
    start = problem.begin(theta)
    seen = problem.point(start)
    assert seen is not None
    for trace, at in zip(traces, seen.seen, strict=True):
        trace.learn_noise(at)
    return Profiler(problem, problem.point_of(start, seen.seen))


def deviations(profiler: Profiler) -> Array:
    """Return the standard deviations of the logarithms."""
    return np.asarray(np.sqrt(np.diag(np.linalg.inv(profiler.information()))))


def linear(seed: int) -> dict[str, Any]:
    """Return by how many standard deviations the optimum of an experiment is off the truth."""
    drawn = draw(seed)
    profiler = _at_truth(drawn, False)
    step = -np.linalg.lstsq(profiler.jacobian, profiler.best.residuals, rcond=None)[0]
    own, best = deviations(profiler), deviations(_at_truth(drawn, True))
    pulls = step[: len(own)] / own
    return {
        "seed": seed, "noise": drawn.noise, "pulls": np.round(pulls, 2).tolist(),
        "wider": np.round(own[:4] / best, 2).tolist(),
    }  # fmt: skip


def whole(seed: int) -> dict[str, Any]:
    """Return what a whole fit of an experiment finds."""
    drawn = draw(seed)
    begun = time.process_time()
    runs = [(one.known, Motion("bench", one.t, one.x)) for one in drawn.traces]
    try:
        found: Fit = identify(runs)
    except IdentificationError as error:
        return {"seed": seed, "noise": drawn.noise, "refused": str(error)}
    took = time.process_time() - begun
    best = 2.0 * CONFIDENCE * deviations(_at_truth(drawn, True))
    values = {}
    for (name, true), ideal in zip(drawn.truth.items(), best.tolist(), strict=True):
        one = found.parameters[name]
        low, high = one.low or 0.0, one.high or math.inf
        values[name] = {
            "part": round(one.value / true, 5), "low": low / true, "high": high / true,
            "determined": one.determined,
            "wider": math.log(high / low) / ideal if low and one.high else math.inf,
        }  # fmt: skip
    return {
        "seed": seed, "noise": drawn.noise, "traces": len(runs), "lag": drawn.lag,
        "seconds": round(took, 1), "values": values, "notes": found.notes,
        "misfit": found.misfit.text if found.misfit else "",
    }  # fmt: skip


def summary(lines: list[dict[str, Any]]) -> str:
    """Return the counts over experiments, in words."""
    if "pulls" in lines[0]:
        pulls = np.array([one["pulls"] for one in lines])
        within = np.abs(pulls) < CONFIDENCE
        usual = np.round(np.sqrt(np.mean(pulls**2, axis=0)), 2)
        text = [f"root mean squares {usual}; {_share(int(within.sum()), within.size)} within 1.96"]
        for kind in NOISES:
            own = within[[one["noise"] == kind for one in lines]]
            text.append(f"{kind}: {_share(int(own.sum()), own.size)}")
        wider = np.round(np.median([one["wider"] for one in lines], axis=0), 2)
        return "\n".join([*text, f"median width over that of a fit that knows all: {wider}"])
    refused = [one for one in lines if "refused" in one]
    lines = [one for one in lines if "refused" not in one]
    text, counts = [f"refused: {len(refused)}"], Counter[tuple[str, bool]]()
    for name in lines[0]["values"]:
        found = [one["values"][name] for one in lines]
        for line, one in zip(lines, found, strict=True):
            if one["determined"]:
                counts[line["noise"], one["low"] <= 1.0 <= one["high"]] += 1
        sure = [one for one in found if one["determined"]]
        held = sum(one["low"] <= 1.0 <= one["high"] for one in sure)
        wider = float(np.median([one["wider"] for one in found]))
        text.append(f"{name}: {_share(held, len(sure))} hold, determined in {len(sure)} of "
                    f"{len(found)}, median width {wider:.2f}")  # fmt: skip
    text += [
        f"{kind}: {_share(counts[kind, True], counts[kind, True] + counts[kind, False])}"
        for kind in NOISES
    ]
    held = sum(count for (_, held), count in counts.items() if held)
    wider = float(np.median([v["wider"] for one in lines for v in one["values"].values()]))
    misfits = sum(bool(one["misfit"]) for one in lines)
    seconds = float(np.mean([one["seconds"] for one in lines]))
    text.append(f"pooled: {_share(held, counts.total())}, median width {wider:.2f}; misfits "
                f"{_share(misfits, len(lines))}; {seconds:.1f} s of processor a fit")  # fmt: skip
    return "\n".join(text)


def _share(part: int, of: int) -> str:
    share = part / max(of, 1)
    error = math.sqrt(share * (1.0 - share) / max(of, 1))
    return f"{part} of {of} ({100.0 * share:.1f} +- {100.0 * error:.1f} %)"


if __name__ == "__main__":
    given = arguments(__doc__, None, {"count": 0, "first": 1000}, linear=False, sum=())
    study = linear if given.linear else whole
    for seed in range(given.first, given.first + given.count):
        print(json.dumps(study(seed)), flush=True)
    if given.sum:
        texts = [Path(path).read_text().splitlines() for path in given.sum]
        print(summary([json.loads(line) for lines in texts for line in lines]))
