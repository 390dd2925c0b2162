# SPDX-License-Identifier: Apache-2.0
"""Traces as they come from a bench: an axis integrated apart from the package, and a bad sensor.

The contact is the CEIM written down once more and left to fourth-order Runge-Kutta steps of fixed
length, restarted at every kink of u(t). Nothing of the package is used.
"""

import math
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

GAIN = 160e-9 / 300.0  #: of the actuator, m/V
SLEWRATE = 100e6  #: of the slip, V/s
#: Longest Runge-Kutta step (s), and least number of steps in a slip.
_LONGEST, _IN_SLIP = 0.5e-6, 60
#: Decays of the ringing after which a runner is at rest.
_DIES_AWAY = 30.0
#: Times in a swing at which a backstep is looked for.
_LOOKS = 300


@dataclass(frozen=True)
class Axis:
    """A runner on its contact: CEIM (Eq. 12-16)."""

    preload: float = 0.4  #: N
    mass: float = 4e-3  #: kg
    sigma_1: float = 5.0  #: N s/m
    sigma_0_offset: float = 7e6  #: N/m, p of Eq. 14
    sigma_0ss: float = 1e7  #: N/m

    @property
    def constants(self) -> tuple[float, float, float, float, float, float]:
        """Mass, sigma_0, sigma_1, z_ba, z_ss, limit of z."""
        z_ba = 2e-8 * self.preload + 1e-8
        sigma_0 = 5e6 * self.preload + self.sigma_0_offset
        z_limit = 0.2 * self.preload / self.sigma_0ss
        return self.mass, sigma_0, self.sigma_1, z_ba, 2.0 * z_ba, z_limit

    @property
    def ringing(self) -> tuple[float, float]:
        """Frequency (Hz), damping included, and decay (1/s) of the runner on its contact."""
        mass, sigma_0, sigma_1, *_ = self.constants
        decay = sigma_1 / (2.0 * mass)
        return math.sqrt(max(sigma_0 / mass - decay**2, 0.0)) / (2.0 * math.pi), decay

    @property
    def parameters(self) -> dict[str, float]:
        """The same by the names of the package."""
        return {
            "preload": self.preload,
            "mass": self.mass,
            "sigma_1": self.sigma_1,
            "sigma_0_offset": self.sigma_0_offset,
            "sigma_0ss": self.sigma_0ss,
        }


@dataclass(frozen=True)
class Drive:
    """Cycles of a sawtooth in one go."""

    cycles: int
    frequency: float = 100.0  #: Hz
    amplitude: float = 300.0  #: V
    direction: int = 1
    pause: float = 0.0  #: rest of the actuator before it, s
    lag: float = 0.0  #: time constant of the amplifier, s; that of the first drive counts
    slewrate: float = SLEWRATE  #: of the slip, V/s


@dataclass(frozen=True)
class Sensor:
    """What a sensor, its cables and its clock make of a motion."""

    rate: float = 100e3  #: Hz
    noise: float = 0.0  #: standard deviation, m
    quantum: float = 0.0  #: of the converter, m
    hum: float = 0.0  #: amplitude of the fundamental, m; harmonics 2 and 3 have 0.4 and 0.3 of it
    mains: float = 50.0  #: Hz
    drift: float = 0.0  #: of the position, m/s
    wander: float = 0.0  #: amplitude of a slow wave of the position, m
    offset: float = 0.0  #: time of the clock when the axis starts to be watched, s
    clock_drift: float = 0.0  #: s/s
    zero: float = 0.0  #: m
    spikes: int = 0  #: single samples far off
    dropouts: int = 0  #: gaps of 3 to 30 samples
    jitter: float = 0.0  #: of the sampling times, part of the distance of samples


@dataclass(frozen=True)
class TrueRun:
    """What really happened, by the clock of the measurement."""

    start: float  #: s
    end: float  #: s
    frequency: float  #: Hz, by the clock of the measurement
    direction: int
    steps: int
    step_size: float  #: mean of the settled steps, of one or two of both, with its sign, m
    backstep: float  #: mean of the settled ones but the last, from slip to deepest point, m


@dataclass(frozen=True)
class Bench:
    """A trace and what is true of it."""

    t: Array
    x: Array
    u: Array
    runs: list[TrueRun]
    axis: Axis
    drives: tuple[Drive, ...]
    sensor: Sensor
    clean: Array = field(repr=False)  #: x without any disturbance


@numba.njit(error_model="numpy", cache=True)  # type: ignore[untyped-decorator]
def _rates(v, z, rate, m, sigma_0, sigma_1, z_ba, z_ss, z_limit):  # type: ignore[no-untyped-def]
    w = v - rate
    alpha = 0.0
    if z * w > 0.0:
        size = abs(z)
        if size >= z_ss:
            alpha = 1.0
        elif size > z_ba:
            alpha = 0.5 + 0.5 * math.sin(math.pi * (size - 0.5 * (z_ss + z_ba)) / (z_ss - z_ba))
    z_rate = w - alpha * abs(w) / z_limit * z
    return -(sigma_0 * z + sigma_1 * z_rate) / m, z_rate


@numba.njit(error_model="numpy", cache=True)  # type: ignore[untyped-decorator]
def _integrated(kinks, rates, longest, times, c):  # type: ignore[no-untyped-def]
    """Return x (m) and u (m) at times (s, increasing); the axis rests at the first kink."""
    out = np.empty((2, len(times)))
    x, v, z, u = 0.0, 0.0, 0.0, 0.0
    at = 0
    while at < len(times) and times[at] <= kinks[0]:
        out[0, at] = 0.0
        out[1, at] = 0.0
        at += 1
    for piece in range(len(rates)):
        rate = rates[piece]
        begin, length = kinks[piece], kinks[piece + 1] - kinks[piece]
        count = max(1, math.ceil(length / longest[piece]))
        h = length / count
        for k in range(count):
            a1, s1 = _rates(v, z, rate, *c)
            a2, s2 = _rates(v + 0.5 * h * a1, z + 0.5 * h * s1, rate, *c)
            a3, s3 = _rates(v + 0.5 * h * a2, z + 0.5 * h * s2, rate, *c)
            a4, s4 = _rates(v + h * a3, z + h * s3, rate, *c)
            new_x = x + h * v + h * h / 6.0 * (a1 + a2 + a3)
            new_v = v + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
            z += h / 6.0 * (s1 + 2.0 * s2 + 2.0 * s3 + s4)
            since = begin + k * h
            until = begin + (k + 1) * h
            while at < len(times) and times[at] <= until:
                p = (times[at] - since) / h  # a cubic through both ends
                q = 1.0 - p
                out[0, at] = (
                    q * q * (1.0 + 2.0 * p) * x
                    + p * p * (1.0 + 2.0 * q) * new_x
                    + h * p * q * (q * v - p * new_v)
                )
                out[1, at] = u + rate * (times[at] - begin)
                at += 1
            x, v = new_x, new_v
        u += rate * length
    while at < len(times):
        out[0, at] = x
        out[1, at] = u
        at += 1
    return out


def _falls(axis: Axis, drive: Drive, ends: Array) -> Array:
    """Times (s) from the slips of settled cycles on, for a swing each, (cycles, looks)."""
    mass, sigma_0, *_ = axis.constants
    slip = drive.amplitude / drive.slewrate
    count = max(drive.cycles - 1, 1)
    settled = ends[1 + (7 if count > 7 else count // 2) : 1 + count] - slip
    swing = min(slip + 2.0 * math.pi * math.sqrt(mass / sigma_0), 0.9 / drive.frequency)
    return np.asarray(settled[:, None] + np.linspace(0.0, swing, _LOOKS))


def _behind_amplifier(
    kinks: list[float], rates: list[float], longest: list[float], lag: float
) -> tuple[list[float], list[float], list[float]]:
    """Return straight pieces of u(t) behind a lag (s), each of its mean rate."""
    edges, means, steps, left = [kinks[0]], [], [], 0.0
    for begin, end, rate, step in zip(kinks, kinks[1:], rates, longest, strict=False):
        fine = 0.02 * lag * np.arange(600)
        since = np.append(fine[fine < 0.999 * (end - begin)], end - begin)
        fades = (left - rate) * np.exp(-since / lag)
        means += (rate - lag * np.diff(fades) / np.diff(since)).tolist()
        edges += (begin + since[1:]).tolist()
        steps += [step] * (len(since) - 1)
        left = rate + float(fades[-1])
    return edges, means, steps


def integrate_pieces(
    axis: Axis,
    kinks: list[float],
    rates: list[float],
    longest: list[float],
    lag: float,
    times: Array,
) -> Array:
    """Return x (m) at times (s) for an actuator that moves in straight pieces.

    kinks (s) bound the pieces, whose rates are in m/s and steps at most so long (s); the amplifier
    may lag (s).
    """
    if lag:
        kinks, rates, longest = _behind_amplifier(kinks, rates, longest, lag)
    pieces = np.array(kinks), np.array(rates), np.array(longest)
    return np.asarray(_integrated(*pieces, times, axis.constants)[0])


@lru_cache(maxsize=64)
def _motion(
    axis: Axis, drives: tuple[Drive, ...], rest: float, rate: float, jitter: float, seed: int
) -> tuple[Array, Array, Array, list[TrueRun]]:
    kinks, rates, longest, starts = [0.0], [], [], []
    for drive in drives:
        if drive.pause > 0.0:
            kinks.append(kinks[-1] + drive.pause)
            rates.append(0.0)
            longest.append(_LONGEST)
        begin, period, slip = kinks[-1], 1.0 / drive.frequency, drive.amplitude / drive.slewrate
        starts.append(begin)
        reach = drive.direction * GAIN * drive.amplitude
        for k in range(drive.cycles):
            kinks += [begin + (k + 1) * period - slip, begin + (k + 1) * period]
            rates += [reach / (period - slip), -reach / slip]
            longest += [_LONGEST, slip / _IN_SLIP]
    kinks.append(kinks[-1] + rest)
    watched = kinks[-1]
    kinks.append(watched + _DIES_AWAY / axis.ringing[1])
    rates += [0.0, 0.0]
    longest += [_LONGEST, _LONGEST]
    if drives[0].lag:
        kinks, rates, longest = _behind_amplifier(kinks, rates, longest, drives[0].lag)
    random = np.random.default_rng(seed)
    t = np.arange(0.0, watched, 1.0 / rate)
    if jitter:
        t = np.sort(t + jitter / rate * random.uniform(-0.5, 0.5, len(t)))
    ends = [
        start + np.arange(drive.cycles + 1) / drive.frequency
        for start, drive in zip(starts, drives, strict=True)
    ]
    falls = [_falls(axis, drive, of) for drive, of in zip(drives, ends, strict=True)]
    every = np.concatenate([t, *ends, *(fall.ravel() for fall in falls), kinks[-1:]])
    order = np.argsort(every, kind="stable")
    found = np.empty((2, len(every)))
    found[:, order] = _integrated(
        np.array(kinks), np.array(rates), np.array(longest), every[order], axis.constants
    )
    each = np.split(found[0, len(t) : -1], np.cumsum([one.size for one in [*ends, *falls]])[:-1])
    runs = []
    nexts = [*(float(x[0]) for x in each[1 : len(drives)]), float(found[0, -1])]
    for drive, times, x, fall, after in zip(
        drives, ends, each, each[len(ends) :], nexts, strict=False
    ):
        steps = np.diff(x)
        settled = steps[7:] if len(steps) > 7 else steps[len(steps) // 2 :]
        if len(steps) < 3:  # they have not settled: the way from rest to rest over their number
            settled = np.array([(after - x[0]) / len(steps)])
        deep = drive.direction * fall.reshape(-1, _LOOKS)
        runs.append(
            TrueRun(
                float(times[0]), float(times[-1]), drive.frequency, drive.direction, drive.cycles,
                float(settled.mean()), float((deep[:, 0] - deep.min(axis=1)).mean()),
            )
        )  # fmt: skip
    return t, found[0, : len(t)], found[1, : len(t)], runs


def with_hum(random: np.random.Generator, t: Array, x: Array, hum: float, mains: float) -> Array:
    """Return readings with hum (m) of mains (Hz) and its harmonics, in phases at random."""
    for harmonic, part in ((1, 1.0), (2, 0.4), (3, 0.3)):
        angle = 2.0 * np.pi * harmonic * mains * t + random.uniform(0.0, 6.0)
        x = x + part * hum * np.sin(angle)
    return x


def pink(random: np.random.Generator, count: int) -> Array:
    """Return 1/f noise of any size."""
    spectrum = np.fft.rfft(random.standard_normal(count))
    spectrum[1:] /= np.sqrt(np.arange(1, len(spectrum)))
    return np.fft.irfft(spectrum, count)


def bench_trace(
    axis: Axis, drives: tuple[Drive, ...], sensor: Sensor, rest: float, seed: int = 0
) -> Bench:
    """Return what a sensor tells of an axis; rest (s) is how long it is watched after the drives.

    The first drive's pause is the rest before.
    """
    t, x, u, runs = _motion(axis, drives, rest, sensor.rate, sensor.jitter, seed)
    random = np.random.default_rng(seed + 1)
    read = x + sensor.zero + sensor.drift * t
    read = read + sensor.wander * np.sin(2.0 * np.pi * t / (0.7 * t[-1]) + random.uniform(0, 6))
    read = with_hum(random, t, read, sensor.hum, sensor.mains)
    read = read + sensor.noise * random.standard_normal(len(t))
    if sensor.quantum:
        read = sensor.quantum * np.round(read / sensor.quantum)
    if sensor.spikes:
        at = random.choice(len(t), sensor.spikes, replace=False)
        read[at] += random.choice([-1.0, 1.0], len(at)) * random.uniform(1e-7, 1e-6, len(at))
    clock = sensor.offset + (1.0 + sensor.clock_drift) * t
    kept = np.ones(len(t), dtype=bool)
    for _ in range(sensor.dropouts):
        first = random.integers(0, len(t))
        kept[first : first + random.integers(3, 31)] = False
    slow = 1.0 + sensor.clock_drift
    runs = [
        replace(
            run,
            start=sensor.offset + slow * run.start,
            end=sensor.offset + slow * run.end,
            frequency=run.frequency / slow,
        )
        for run in runs
    ]
    return Bench(clock[kept], read[kept], u[kept], runs, axis, drives, sensor, x[kept])


def random_axis(random: np.random.Generator) -> Axis:
    """Return an axis that steps well."""
    return Axis(
        preload=float(random.uniform(0.2, 1.2)),
        mass=float(random.uniform(3e-3, 10e-3)),
        sigma_1=float(random.uniform(3.0, 15.0)),
        sigma_0_offset=float(random.uniform(4e6, 9e6)),
        sigma_0ss=float(random.uniform(0.7e7, 1.5e7)),
    )


def random_bench(seed: int) -> Bench:
    """Return a trace with up to three drives and random disturbances."""
    random = np.random.default_rng(seed)
    axis = random_axis(random)
    frequency = float(np.exp(random.uniform(np.log(60.0), np.log(6e3))))
    amplitude = float(random.uniform(150.0, 300.0))
    rate = float(np.clip(random.choice([1e5, 2e5, 5e5, 1e6]), 12.0 * frequency, 2e4 * frequency))
    period = 1.0 / frequency
    first = Drive(
        cycles=int(random.integers(10, 31)),
        frequency=frequency,
        amplitude=amplitude,
        direction=int(random.choice([-1, 1])),
        pause=float(max(random.uniform(0.6, 4.0) * period, 2e-3)),
    )
    drives = [first]
    if random.random() < 0.1:
        drives[0] = first = replace(first, cycles=int(random.integers(2, 6)))
    for _ in range(int(random.choice([0, 0, 1, 2]))):
        kind = random.choice(["back", "again", "amplitude", "frequency"])
        drive = replace(
            first,
            cycles=int(random.integers(4, 16)),
            pause=float(max(random.uniform(1.0, 4.0) * period, 4e-3)),
        )
        if kind == "back":
            drive = replace(drive, direction=-first.direction)
        elif kind == "amplitude":
            drive = replace(drive, amplitude=amplitude * float(random.uniform(0.6, 0.8)))
        elif kind == "frequency":
            drive = replace(drive, frequency=frequency * float(random.uniform(0.5, 0.8)))
        drives.append(drive)
    sensor = Sensor(
        rate=rate,
        noise=float(random.uniform(1e-9, 3e-9)),
        offset=float(random.uniform(-0.5, 0.5)),
        zero=float(random.uniform(-1e-6, 1e-6)),
    )
    sensor = replace(
        sensor,
        noise=float(random.choice([sensor.noise, random.uniform(3e-9, 8e-9)])),
        quantum=float(random.choice([0.0, 0.0, 1e-9, 5e-9])),
        hum=float(random.choice([0.0, 0.0, random.uniform(2e-9, 15e-9)])),
        mains=float(random.choice([50.0, 60.0])),
        drift=float(random.choice([0.0, random.uniform(-2e-7, 2e-7)])),
        clock_drift=float(random.choice([0.0, random.uniform(-1e-4, 1e-4)])),
        spikes=int(random.choice([0, 0, 3, 10])),
        dropouts=int(random.choice([0, 0, 2])),
        jitter=float(random.choice([0.0, 0.0, 0.5])),
    )
    rest = float(max(random.uniform(0.6, 4.0) * period, 4e-3))
    return bench_trace(axis, tuple(drives), sensor, rest, seed)
