# SPDX-License-Identifier: Apache-2.0
"""Recordings of actuators as a bench makes them, drawn by models that the package does not have.

Nothing of the package is used. Hysteresis is that of Preisach (a plane of relays), of Bouc and Wen
(a rate equation), or of Maxwell slip (springs that slide). Creep is the superposition of
logarithms, one for each change of the deflection. Drift, noise, rests, amplitudes that change, and
a begin and an end anywhere come with them.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
FULL = 120.0  #: V
STROKE = 11e-6  #: m at FULL


def preisach(volts: Array) -> Array:
    """Relays that switch up at one voltage and down at a lower one, more of them near its axis."""
    grid = np.linspace(-0.1 * FULL, 1.1 * FULL, 60)
    up, down = (one.ravel() for one in np.meshgrid(grid, grid))
    up, down = up[up >= down], down[up >= down]
    weight = np.exp(-(up - down) / (0.12 * FULL))
    on = up <= volts[0]
    found = []
    for volt in volts.tolist():
        on = np.where(up <= volt, True, np.where(down >= volt, False, on))
        found.append(float(weight @ on))
    linear = 0.6 * volts / FULL
    return np.asarray(STROKE * (0.5 * np.array(found) / weight.sum() + linear))


def bouc_wen(volts: Array) -> Array:
    """v - z with z' = a v' - b |v'| z."""
    z, found = 0.0, [0.0]
    for change in np.diff(volts).tolist():
        z += 0.35 * change - 0.022 * abs(change) * z
        found.append(z)
    return np.asarray(STROKE / FULL * (volts - np.array(found)))


def maxwell_slip(volts: Array) -> Array:
    """Springs of six lengths before they slide, and one that never does; lags as force does not."""
    limits = FULL * np.array([0.02, 0.05, 0.11, 0.2, 0.31, 0.44])
    stiffness = np.array([0.12, 0.08, 0.06, 0.04, 0.03, 0.03])
    force, found = np.zeros(len(limits)), [0.0]
    for change in np.diff(volts).tolist():
        force = np.clip(force + change, -limits, limits)
        found.append(float(stiffness @ force))
    return np.asarray(STROKE / FULL * (volts - np.array(found)))


MODELS: tuple[Callable[[Array], Array], ...] = (preisach, bouc_wen, maxwell_slip)


@dataclass(frozen=True)
class Bench:
    """A recording and what is true of it."""

    times: Array  #: s
    volts: Array  #: V
    deflection: Array  #: m, as measured
    hysteresis: Array  #: m, without creep, drift and noise


def voltage(chance: np.random.Generator, rate: float) -> Array:
    """Rest, cycles of one kind, perhaps a rest and cycles of less, and an end anywhere; V."""
    period = chance.uniform(1.0, 4.0)
    kind = chance.integers(3)
    rise = chance.uniform(0.3, 0.7)

    def cycles(count: float, low: float, high: float) -> Array:
        phase = np.arange(0.0, count, 1.0 / (rate * period)) % 1.0
        share = 0.5 - 0.5 * np.cos(2.0 * np.pi * phase)
        if kind:
            share = np.interp(phase, [0.0, rise, 1.0], [0.0, 1.0, 0.0])
        return np.asarray(low + (high - low) * share)

    def rest(volts: float) -> Array:
        return np.full(int(rate * chance.uniform(1.0, 15.0)), volts)

    parts = [rest(0.0), cycles(int(chance.integers(2, 6)) + 1e-9, 0.0, FULL)]
    if chance.random() < 0.6:
        low, high = np.sort(chance.uniform(0.0, FULL, 2))
        way = np.linspace(0.0, low, int(0.5 * rate))
        parts += [way, cycles(int(chance.integers(1, 4)) + 0.5, low, high), rest(high)]
        parts.append(np.linspace(high, 0.0, int(rate)))
        parts.append(cycles(chance.uniform(1.0, 2.0), 0.0, FULL))
    return np.concatenate(parts)


def crept(times: Array, deflection: Array, creep: float, start: float) -> Array:
    """Add creep log10(1 + t / start) of every change of the deflection, t being the time since."""
    found = deflection.copy()
    for k, change in enumerate(np.diff(deflection).tolist(), 1):
        if change:
            found[k:] += creep * change * np.log10(1.0 + (times[k:] - times[k]) / start)
    return found


def bench(
    model: Callable[[Array], Array],
    seed: int,
    creep: float = 0.0,
    drift: float = 0.0,
    noise: float = 0.0,
) -> Bench:
    """Draw a recording; creep as a share in a decade from 0.1 s on, drift and noise of STROKE.

    drift is what the whole recording drifts by, noise the standard deviation.
    """
    chance = np.random.default_rng(seed)
    volts = voltage(chance, rate=100.0)
    times = np.arange(len(volts)) / 100.0
    hysteresis = model(volts)
    deflection = crept(times, hysteresis, creep, 0.1) if creep else hysteresis.copy()
    deflection += STROKE * drift * times / times[-1]
    deflection += STROKE * noise * chance.standard_normal(len(times)) + chance.uniform(-1, 1) * 1e-5
    return Bench(times, volts, deflection, hysteresis)
