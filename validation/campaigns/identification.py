# SPDX-License-Identifier: Apache-2.0
"""How often identify is right: random experiments, from integrators that share nothing with it.

    python -m validation.campaigns.identification intervals|misfit COUNT [FIRST] >> FILE
    python -m validation.campaigns.identification STUDY 0 --sum FILE [FILE ...]

Each experiment prints a line of JSON; the second counts those of files. ``intervals``: a contact
behind a sensor as they are, 60 Hz to 2 kHz, 3 to 300 steps: latency, resolution, white and pink
noise, a walk, hum, drift, a bandwidth, samples that are points or means, a lag of the amplifier of
up to 2 us. Half of the files say how the sensor samples. Widths are given beside those of a linear
estimate at the truth that is told the noise (the Cramer-Rao bound). ``misfit``: what the model does
not have, by turns; an experiment is silent if it names nothing and a value is off by more than half
the width of its interval beyond its end.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from bench_traces import (
    GAIN,
    SLEWRATE,
    Array,
    Axis,
    Drive,
    integrate_pieces,
    pink,
    random_axis,
    with_hum,
)
from experiments import truth_of
from other_axes import Other, other_trace

from stickslip_ros.base.reporting import CONFIDENCE
from stickslip_ros.measurement.identification import Experiment, Fit, IdentificationError, identify
from stickslip_ros.measurement.identification.experiment import Stepping
from stickslip_ros.measurement.identification.free import (
    free_parameters,
    lag_of_amplifier,
    width_of_sensor,
)
from stickslip_ros.measurement.identification.problem import Problem
from stickslip_ros.measurement.identification.trace import Trace
from stickslip_ros.measurement.steps.ringing import Ringing
from stickslip_ros.physics.parameters import Parameters
from stickslip_ros.simulation.motion import Motion
from validation.campaigns.arguments import arguments

#: What a sample is averaged over, in looks; most samples of a record.
OVER, MOST = 10, 100_000


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
class Actual:
    """What an axis has that the model of a file may not."""

    lag: float = 0.0  #: of the amplifier, s
    slewrate: float = SLEWRATE  #: of the slip, V/s
    creep: float = 0.0  #: of the actuator, part of the deflection a decade
    hysteresis: float = 0.0  #: bow of a loop, part of the stroke


@dataclass(frozen=True)
class Instrument:
    """A sensor as they are."""

    rate: float  #: Hz
    bandwidth: float | None  #: Hz, first order
    mean: bool  #: whether samples are means over the time from one to the next
    latency: float  #: s
    white: float  #: standard deviation of a sample, m
    pink: float  #: m
    walk: float  #: over the record, m
    hum: float  #: m
    mains: float  #: Hz
    drift: float  #: m/s
    resolution: float  #: m

    @classmethod
    def draw(cls, random: np.random.Generator, rate: float) -> Instrument:
        """Return a random one."""

        def sometimes(low: float, high: float) -> float:
            return float(random.choice([0.0, random.uniform(low, high)]))

        logarithm = sometimes(math.log(2e4), math.log(2e5))
        return cls(
            rate=rate,
            bandwidth=math.exp(logarithm) if logarithm else None,
            mean=bool(random.integers(2)),
            latency=float(random.uniform(0.0, 50e-6)),
            white=float(random.uniform(0.3e-9, 3e-9)),
            pink=sometimes(0.3e-9, 2e-9),
            walk=sometimes(2e-9, 2e-8),
            hum=sometimes(2e-9, 15e-9),
            mains=float(random.choice([50.0, 60.0])) + float(random.normal(0.0, 0.03)),
            drift=sometimes(-2e-7, 2e-7),
            resolution=float(random.choice([0.0, 1e-10, 1e-9])),
        )

    def looks(self, end: float) -> Array:
        """Return the times (s) at which the motion has to be known."""
        return np.arange(OVER * int(end * self.rate)) / (OVER * self.rate)

    def read(self, t: Array, x: Array, random: np.random.Generator) -> tuple[Array, Array, Array]:
        """Return times, readings, and readings with white and pink noise and the walk alone."""
        if self.bandwidth:
            share = 2.0 * math.pi * self.bandwidth / (OVER * self.rate)
            x = low_pass(x, 1.0 - math.exp(-share))
        parts = x.reshape(-1, OVER)
        seen = parts.mean(axis=1) if self.mean else parts[:, 0]
        times = t[::OVER] + self.latency
        count = len(times)
        noise = self.white * random.standard_normal(count)
        shaped = pink(random, count)
        noise += self.pink * shaped / np.std(shaped)
        noise += self.walk * np.cumsum(random.standard_normal(count)) / math.sqrt(count)
        quiet = seen + noise
        read = with_hum(random, times, quiet + self.drift * times, self.hum, self.mains)
        if self.resolution:
            read = self.resolution * np.round(read / self.resolution)
        return times, read, quiet


def low_pass(x: Array, share: float) -> Array:
    """Return values behind a filter of first order that takes up a share of each step."""
    from scipy.signal import lfilter

    return np.asarray(lfilter([share], [1.0, share - 1.0], x))


def motion(axis: Axis, drive: Drive, actual: Actual, times: Array) -> Array:
    """Return x (m) of an axis whose actuator may creep and have hysteresis."""
    period, slip = 1.0 / drive.frequency, drive.amplitude / actual.slewrate
    reach, kinks, rates, longest = GAIN * drive.amplitude, [0.0, drive.pause], [0.0], [0.5e-6]
    bow = actual.hysteresis
    parts = np.linspace(0.0, 1.0, 25 if bow else 2)
    for k in range(drive.cycles):
        begin = drive.pause + k * period
        for length, sign, start in (
            (period - slip, 1.0, begin),
            (slip, -1.0, begin + period - slip),
        ):
            level = parts - bow * parts * (1.0 - parts)  # both branches lag behind the voltage
            since = level if sign > 0.0 else -level
            kinks += (start + length * parts[1:]).tolist()
            rates += (reach * np.diff(since) / (length * np.diff(parts))).tolist()
            longest += [0.5e-6 if sign > 0.0 else slip / 60.0] * (len(parts) - 1)
    kinks.append(float(times[-1]) + 1e-3)
    rates.append(0.0)
    longest.append(0.5e-6)
    if actual.creep:  # of the mean level, slowly
        at = np.array(kinks)
        slow = 0.5 * reach * actual.creep * np.log10(1.0 + np.maximum(at - drive.pause, 0.0) / 2e-3)
        rates = (np.array(rates) + np.diff(slow) / np.diff(at)).tolist()
    return integrate_pieces(axis, kinks, rates, longest, actual.lag, times)


@dataclass(frozen=True)
class Drawn:
    """A random experiment."""

    axis: Axis
    drive: Drive
    actual: Actual
    sensor: Instrument
    file: Mapping[str, Any]  #: the drive file
    said: str | None  #: how samples are taken, where it is said
    measured: tuple[Array, Array, Array]

    @property
    def truth(self) -> dict[str, float]:
        """The constants that have to be found."""
        return truth_of(self.axis)


def draw(seed: int, actual: Actual | None = None, **changed: Any) -> Drawn:
    """Return an experiment; changed replaces what its file says, by factors."""
    random = np.random.default_rng(seed)
    plain = random_axis(random)
    axis = ScaledAxis(
        plain.preload, plain.mass, plain.sigma_1, plain.sigma_0_offset,
        plain.sigma_0ss * float(random.uniform(0.7, 1.5)), float(random.uniform(0.6, 1.8)),
    )  # fmt: skip
    frequency = math.exp(random.uniform(math.log(60.0), math.log(2000.0)))
    rate = float(random.choice([1e5, 2e5, 5e5, 1e6]))
    most = min(300.0, 0.8 * MOST * frequency / rate)
    steps = max(int(math.exp(random.uniform(math.log(3.0), math.log(max(most, 4.0))))), 3)
    pause = max(float(random.uniform(0.6, 3.0)) / frequency, 2e-3)
    drive = Drive(steps, frequency, float(random.uniform(150.0, 300.0)), 1, pause)
    lag = float(random.choice([0.0, random.uniform(0.0, 2e-6)]))
    actual = actual or Actual(lag=lag)
    sensor = Instrument.draw(random, rate)
    said = None if random.random() < 0.5 else ("mean" if sensor.mean else "point")
    times = sensor.looks(2.0 * pause + steps / frequency)
    measured = sensor.read(times, motion(axis, drive, actual, times), random)
    truth = truth_of(axis)
    wrong = np.exp(random.uniform(-np.log(3.0), np.log(3.0), len(truth)))
    file: dict[str, Any] = {
        "preload": axis.preload, "mass": axis.mass, "frequency": frequency,
        "amplitude": drive.amplitude, "slewrate": 1e-6 * SLEWRATE, "gain": GAIN,
    }  # fmt: skip
    file |= {name: value * part for (name, value), part in zip(truth.items(), wrong, strict=True)}
    if said and sensor.bandwidth:
        file["sensor_bandwidth"] = sensor.bandwidth
    file |= {name: file[name] * factor for name, factor in changed.items()}
    return Drawn(axis, drive, actual, sensor, file, said, measured)


def bound_of(drawn: Drawn) -> Array:
    """Return the deviations of an ideal linear estimate that is told the noise.

    Its unknowns are those of the fit, with the zero, drift and hum; the noise is that of a record
    without hum and drift about the truth.
    """
    t, _, quiet = drawn.measured
    truth = drawn.truth
    p = Parameters.of({**drawn.file, **truth})
    start = drawn.drive.pause + drawn.sensor.latency
    ringing = Ringing(*drawn.axis.ringing)
    stepping = Stepping(start, drawn.drive.cycles, drawn.drive.frequency)
    measured = Experiment(p, Motion("bench", t, quiet), (stepping,), ringing, samples=drawn.said)
    trace = Trace(measured)
    unsaid = drawn.said is None and not p.sensor.sensor_bandwidth
    nuisances = [lag_of_amplifier(), *([width_of_sensor(1.0 / drawn.sensor.rate)] * unsaid)]
    problem = Problem([trace], free_parameters([p], list(truth)), nuisances)
    unknowns = problem.begin(np.log(list(truth.values())))
    unknowns[problem.count] = 1e6 * drawn.actual.lag
    if unsaid:
        width = (2.0 * math.pi * (drawn.sensor.bandwidth or 1e12)) ** -2
        width += drawn.sensor.mean / (12.0 * drawn.sensor.rate**2)
        unknowns[problem.count + 1] = 1e12 * width
    trace.learn(problem.seen(unknowns)[0])
    at = problem.point(unknowns)
    assert at is not None
    covariance = problem.covariance(problem.jacobian(at, central=True))
    return np.sqrt(np.diag(covariance))[: problem.count]


def fitted(drawn: Drawn, **how: Any) -> tuple[Fit | str, float]:
    """Return the fit of an experiment, or why it was refused, and the seconds of processor."""
    begun = time.process_time()
    t, x, _ = drawn.measured
    try:
        found: Fit | str = identify([(drawn.file, t, x)], samples=drawn.said, **how)
    except IdentificationError as error:
        found = str(error)
    return found, round(time.process_time() - begun, 1)


def intervals(seed: int) -> dict[str, Any]:
    """Return whether the intervals of an experiment hold the truth."""
    drawn = draw(seed)
    found, took = fitted(drawn)
    about = {
        "seed": seed, "seconds": took, "said": drawn.said, "steps": drawn.drive.cycles,
        "frequency": round(drawn.drive.frequency), "samples": len(drawn.measured[0]),
        "lag": drawn.actual.lag, "bandwidth": drawn.sensor.bandwidth, "mean": drawn.sensor.mean,
    }  # fmt: skip
    if isinstance(found, str):
        return about | {"refused": found}
    ideal = (2.0 * CONFIDENCE * bound_of(drawn)).tolist()
    values = {}
    for (name, true), best in zip(drawn.truth.items(), ideal, strict=True):
        one = found.parameters[name]
        low, high = one.low or 0.0, one.high or math.inf
        values[name] = {
            "part": round(one.value / true, 5), "low": low / true, "high": high / true,
            "inside": low <= true <= high,
            "wider": math.log(high / low) / best if low and math.isfinite(high) else None,
        }  # fmt: skip
    misfit = found.misfit.text if found.misfit else ""
    return about | {"values": values, "misfit": misfit, "notes": found.notes}


#: What the model, or the file, does not have.
MISFITS: Mapping[str, Callable[[np.random.Generator], tuple[Actual | None, dict[str, float]]]] = {
    "lag": lambda r: (Actual(lag=r.uniform(0.7e-6, 2e-6)), {}),
    "creep": lambda r: (Actual(creep=r.uniform(0.01, 0.04)), {}),
    "tilt": lambda r: (Actual(), {}),
    "preload": lambda r: (Actual(), {"preload": r.uniform(1.1, 1.3)}),
    "slewrate": lambda r: (Actual(), {"slewrate": r.uniform(1.1, 1.5)}),
    "gain": lambda r: (Actual(), {"gain": r.uniform(1.02, 1.1)}),
    "drift of preload": lambda r: (Actual(), {}),
    "payload": lambda r: (Actual(), {"mass": r.uniform(0.7, 0.9)}),
    "bandwidth": lambda r: (Actual(), {}),
    "hysteresis": lambda r: (Actual(hysteresis=r.uniform(0.05, 0.2)), {}),
    "second contact": lambda r: (Actual(), {}),
}


def misfit(seed: int) -> dict[str, Any]:
    """Return whether something that the model does not have is told, or moves nothing."""
    random = np.random.default_rng(90_000 + seed)
    kind = list(MISFITS)[seed % len(MISFITS)]
    actual, changed = MISFITS[kind](random)
    drawn = draw(seed, actual, **changed)
    t, x, quiet = drawn.measured
    if kind == "tilt":
        x = x * float(random.uniform(0.92, 0.97))
    if kind == "bandwidth":
        share = 1.0 - math.exp(
            -2.0 * math.pi * float(random.uniform(1.5e4, 3e4)) / drawn.sensor.rate
        )
        x = low_pass(x, share)
        drawn = replace(drawn, said="point")
    if kind in ("drift of preload", "second contact"):
        other = Other(jump=float(random.uniform(0.1, 0.3)))
        if kind == "second contact":
            other = Other(second=float(random.uniform(0.1, 0.3)))
        t, x = other_trace(
            drawn.axis, other, drawn.drive, drawn.sensor.rate, drawn.sensor.white, seed
        )
    drawn = replace(drawn, measured=(t, x, quiet))
    found, took = fitted(drawn, fit_lag=False if kind == "lag" else None)
    about = {"seed": seed, "kind": kind, "seconds": took, "steps": drawn.drive.cycles}
    if isinstance(found, str):
        return about | {"refused": found}
    off = {}
    for name, true in drawn.truth.items():
        one = found.parameters[name]
        low, high = one.low or 0.0, one.high or math.inf
        beyond = max(low - true, true - high, 0.0) / (high - low) if math.isfinite(high) else 0.0
        off[name] = round(beyond, 2)
    told = found.misfit.text if found.misfit else ""
    given = {"preload": "preload", "payload": "mass", "slewrate": "slewrate", "gain": "gain",
             "lag": "a lag of", "bandwidth": "a sensor of"}  # fmt: skip
    said = any(given.get(kind, "-") in line.partition(" would not")[0] for line in found.given)
    silent = not told and not said and max(off.values()) > 0.5
    return about | {"off": off, "misfit": told, "said": said, "silent": silent}


def summary(lines: Sequence[dict[str, Any]]) -> str:
    """Return the counts over experiments, in words."""
    whole = [one for one in lines if "refused" not in one]
    text = [f"{len(lines)} experiments, {len(lines) - len(whole)} refused"]
    if "values" in whole[0]:
        for name in whole[0]["values"]:
            found = [one["values"][name] for one in whole]
            wider = [one["wider"] for one in found if one["wider"]]
            text.append(
                f"{name}: {_share(sum(one['inside'] for one in found), len(found))} inside, median "
                f"width {np.median(wider):.2f} of the bound, {len(found) - len(wider)} open"
            )
        named = sum(bool(one["misfit"]) for one in whole)
        text.append(f"misfit named: {_share(named, len(whole))}")
    for kind in dict.fromkeys(one["kind"] for one in whole if "kind" in one):
        own = [one for one in whole if one["kind"] == kind]
        told = sum(bool(one["misfit"]) or one["said"] for one in own)
        silent = sum(one["silent"] for one in own)
        text.append(f"{kind}: {told} of {len(own)} told, {silent} wrong in silence")
    if "seconds" in whole[0]:
        seconds = [one["seconds"] for one in whole]
        text.append(f"{np.mean(seconds):.1f} s of processor a fit, at most {max(seconds):.1f} s")
    return "\n".join(text)


def _share(part: int, of: int) -> str:
    share = part / max(of, 1)
    error = math.sqrt(share * (1.0 - share) / max(of, 1))
    return f"{part} of {of} ({100.0 * share:.1f} +- {100.0 * error:.1f} %)"


STUDIES: Mapping[str, Callable[[int], dict[str, Any]]] = {"intervals": intervals, "misfit": misfit}


if __name__ == "__main__":
    given = arguments(__doc__, None, {"study": {*STUDIES}, "count": int, "first": 1}, sum=())
    if given.sum:
        texts = [Path(path).read_text().splitlines() for path in given.sum]
        print(summary([json.loads(line) for lines in texts for line in lines]))
    else:
        for seed in range(given.first, given.first + given.count):
            print(json.dumps(STUDIES[given.study](seed)), flush=True)
