# SPDX-License-Identifier: Apache-2.0
"""What identify finds in random experiments, beside the coverage that `intervals` counts.

    python -m validation.campaigns.identification fits|preloads|misfit|laws|next COUNT [FIRST_SEED]

``fits``: one trace of 12 cycles with 1 nm of noise at 0.5 MHz. ``preloads``: the same at five
preloads, for Eq. 13 and 14. ``misfit``: a lag of the amplifier of 1.5 us, a second contact, a
preload that steps half-way, and none of these. ``laws``: contacts of LuGre, EPM and CEIM. ``next``:
three runs as suggested against three at random. Traces come from integrators that share nothing
with the package.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from bench_traces import Axis, Drive, Sensor, bench_trace, random_axis
from experiments import experiment, truth_of
from other_axes import Other, other_trace

from stickslip_ros.identification import RANKED_LAWS, Fit, identify
from stickslip_ros.motion.motion import Motion
from stickslip_ros.parameters import Parameters
from validation.campaigns.arguments import arguments

#: What is measured each time for `next_runs`, s.
RECORD = 0.02
#: What is known of a drive, and its trace.
Run = tuple[Parameters, Motion]
OTHERS = {
    "none": Other(),
    "lag": Other(lag=1.5e-6),
    "second contact": Other(second=0.15),
    "preload": Other(jump=0.2),
}


@dataclass(frozen=True)
class FreeAxis(Axis):
    """An axis whose Eq. 13 and 14 have slopes and offsets of their own."""

    sigma_0_slope: float = 5e6  #: 1/m
    z_ba_slope: float = 2e-8  #: m/N
    z_ba_offset: float = 1e-8  #: m

    @property
    def constants(self) -> tuple[float, float, float, float, float, float]:
        """Mass, sigma_0, sigma_1, z_ba, z_ss, limit of z."""
        z_ba = self.z_ba_slope * self.preload + self.z_ba_offset
        sigma_0 = self.sigma_0_slope * self.preload + self.sigma_0_offset
        return (
            self.mass, sigma_0, self.sigma_1, z_ba, 2.0 * z_ba, 0.2 * self.preload / self.sigma_0ss,
        )  # fmt: skip


def wrong(random: np.random.Generator, names: Mapping[str, float]) -> dict[str, float]:
    """Return by which factors starting values are off, up to 3."""
    return {name: math.exp(random.uniform(-math.log(3.0), math.log(3.0))) for name in names}


def off(found: Fit, truth: Mapping[str, float]) -> str:
    """Return by how much values are off, in per cent."""
    return ", ".join(
        f"{name} {100.0 * (found.parameters[name].value / true - 1.0):+.2f} %"
        for name, true in truth.items()
    )


def fits(seed: int) -> str:
    """One trace."""
    random = np.random.default_rng(seed)
    axis = random_axis(random)
    truth = truth_of(axis)
    run = experiment(
        axis, Drive(12, pause=0.01), Sensor(rate=5e5, noise=1e-9), seed, wrong(random, truth), 8e-3
    )
    return off(identify([run]), truth)


def preloads(seed: int) -> str:
    """Five preloads."""
    random = np.random.default_rng(seed)
    plain = random_axis(random)
    axis = FreeAxis(
        1.0, plain.mass, plain.sigma_1, plain.sigma_0_offset, plain.sigma_0ss,
        *(float(random.uniform(0.6, 1.6)) * value for value in (5e6, 2e-8, 1e-8)),
    )  # fmt: skip
    names = ("sigma_0_slope", "sigma_0_offset", "z_ba_slope", "z_ba_offset", "sigma_1", "sigma_0ss")
    truth = {name: float(getattr(axis, name)) for name in names}
    start = {name: truth[name] * part for name, part in wrong(random, truth).items()}
    runs = []
    for k, preload in enumerate((0.2, 0.4, 0.6, 0.9, 1.2)):
        drive = Drive(12, float(random.uniform(100.0, 400.0)), 300.0, 1, 0.01)
        bench = bench_trace(
            replace(axis, preload=preload), (drive,), Sensor(rate=5e5, noise=1e-9), 8e-3, seed + k
        )
        known = {"preload": preload, "mass": axis.mass, "frequency": drive.frequency}
        p = Parameters.of({**known, "amplitude": 300.0, **start})
        runs.append((p, Motion(f"{preload} N", bench.t, bench.x)))
    return off(identify(runs), truth)


def _other_run(seed: int, other: Other) -> tuple[Run, dict[str, float]]:
    random = np.random.default_rng(seed)
    axis = replace(random_axis(random), preload=float(random.uniform(0.3, 1.0)))
    truth = truth_of(axis)
    frequency = math.exp(random.uniform(math.log(100.0), math.log(800.0)))
    drive = Drive(12, frequency, float(random.uniform(220.0, 300.0)), 1, 8e-3)
    t, x = other_trace(axis, other, drive, 5e5, 1e-9, seed)
    known = {"preload": axis.preload, "mass": axis.mass, "frequency": frequency,
             "amplitude": drive.amplitude}  # fmt: skip
    start = {name: truth[name] * part for name, part in wrong(random, truth).items()}
    return (Parameters.of({**known, **start}), Motion("lab", t, x)), truth


def misfit(seed: int) -> str:
    """Axes that no parameters explain, and one that they do, by turns."""
    name = list(OTHERS)[seed % len(OTHERS)]
    run, truth = _other_run(seed, OTHERS[name])
    found = identify([run], fit_lag=False)
    return f"{name}: {off(found, truth)}: {found.misfit.text if found.misfit else 'no misfit'}"


def laws(seed: int) -> str:
    """Contacts of other laws, by turns."""
    law = ("lugre", "epm_fix", "ceim", "epm_calc")[seed % 4]
    run, _ = _other_run(seed, Other(law=law))
    found = identify([run], laws=list(RANKED_LAWS)).laws
    order = ", ".join(f"{one.law} {one.score:.0f}" for one in found)
    likely = ", ".join(one.law for one in found if one.likely)
    place = "first" if found[0].law == law else "NOT first"
    return f"{law} is {place}: {order}; not told apart: {likely}"


def _widest(found: Fit) -> float:
    return max(
        math.log(one.high / one.low) if one.low and one.high else math.inf
        for one in found.parameters.values()
        if one.name != "amplifier_lag"
    )


def _measured(axis: Axis, drive: Drive, rate: float, payload: float, seed: int) -> Run:
    sensor = Sensor(rate=rate, noise=2e-9)
    pause = max(0.06 * RECORD, 0.3 / drive.frequency)
    loaded = replace(axis, mass=axis.mass + payload)
    p, motion = experiment(loaded, replace(drive, pause=pause), sensor, seed, rest=pause)
    return p.replace(mass=axis.mass, payload=payload), motion


def _by_lot(random: np.random.Generator, low: float, high: float) -> Drive:
    """Return a drive that fills a record, with four steps at least."""
    frequency = math.exp(random.uniform(math.log(low), math.log(high)))
    steps = max(int(0.88 * RECORD * frequency), 4)
    return Drive(steps, frequency, float(random.uniform(100.0, 300.0)))


def next_runs(seed: int) -> str:
    """Three runs as suggested, and three at random, after the same first one of 20 ms."""
    random = np.random.default_rng(seed)
    axis = random_axis(random)
    first = _measured(axis, _by_lot(random, 300.0, 1500.0), 5e5, 0.0, seed)
    by_lot = [
        _measured(axis, _by_lot(random, 80.0, 2000.0), 5e5, 0.0, 100 * seed + k) for k in range(3)
    ]
    runs, found, texts = [first], identify([first], suggest_next=True), []
    for k in range(3):
        told = found.next
        assert told is not None
        # No more time is spent than at random, whatever the rate.
        steps = max(min(told.steps, int(0.88 * RECORD * told.frequency)), 4)
        drive = Drive(steps, told.frequency, told.amplitude, slewrate=1e6 * told.slewrate)
        runs.append(_measured(axis, drive, 5e5, told.payload, 100 * seed + k))
        found = identify(runs, suggest_next=k < 2)
        expected, one = math.log(told.high / told.low), found.parameters[told.parameter]
        width = math.log(one.high / one.low) if one.low and one.high else math.inf
        texts.append(
            f"{told.amplitude:.0f} V, {told.frequency:.0f} Hz, payload {1e3 * told.payload:.0f} g: "
            f"{told.parameter} {width:.4f} (expected {expected:.4f}), widest {_widest(found):.4f}"
        )
    suggested, random_ones = _widest(found), _widest(identify([first, *by_lot]))
    return (
        f"widest interval {suggested:.4f} as suggested, {random_ones:.4f} at random (logarithms):"
        f" {suggested / random_ones:.2f} of it; {'; '.join(texts)}; {off(found, truth_of(axis))}"
    )


STUDIES: Mapping[str, Callable[[int], str]] = {
    "fits": fits,
    "preloads": preloads,
    "misfit": misfit,
    "laws": laws,
    "next": next_runs,
}


def main(study: str, count: int, first: int) -> None:
    """Print a line for each experiment."""
    for seed in range(first, first + count):
        begun, clock = time.process_time(), time.monotonic()
        text = STUDIES[study](seed)
        took, wall = time.process_time() - begun, time.monotonic() - clock
        print(f"{study} {seed}: {took:.0f} s of CPU, {wall:.0f} s: {text}", flush=True)


if __name__ == "__main__":
    given = arguments(__doc__, None, {"study": {*STUDIES}, "count": int, "first": 1})
    main(given.study, given.count, given.first)
