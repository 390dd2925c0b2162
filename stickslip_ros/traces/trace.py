# SPDX-License-Identifier: Apache-2.0
"""A run sampled over time: runner, actuator and contact."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass, fields
from itertools import pairwise
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.files import whole_file
from stickslip_ros.model import DriveCycle, drive_of, plant_of
from stickslip_ros.parameters import Parameters
from stickslip_ros.solver import Simulation


@dataclass(frozen=True)
class Trace:
    """Samples of a run, each of shape (samples,)."""

    t: NDArray[np.float64]  #: time, s
    x: NDArray[np.float64]  #: runner position, m
    v: NDArray[np.float64]  #: runner velocity, m/s
    u: NDArray[np.float64]  #: actuator deflection, m
    z: NDArray[np.float64]  #: asperity deflection, m
    w: NDArray[np.float64]  #: differential velocity v - u', m/s
    force: NDArray[np.float64]  #: friction force F, N


#: Names of the samples with units, in their order.
HEADER = ("time (s)", "runner (m)", "runner velocity (m/s)", "actuator (m)",
           "deflection (m)", "differential velocity (m/s)", "friction force (N)")  # fmt: skip


def trace_steps(p: Parameters | Mapping[str, Any], steps: int, density: float = 40.0) -> Trace:
    """Run steps (sign: direction) from rest, sampled so that ringing and slips can be seen.

    density is that of the samples in a period of the ringing, within bounds. The kinks of u(t) are
    among the samples. Raises ParameterError.
    """
    p = Parameters.of(p)
    plant = plant_of(p)
    simulation = Simulation(plant, p.solver.tolerance)
    pattern = drive_of(p, 1 if steps >= 0 else -1)
    simulation.start(pattern, abs(steps))
    within = _sample_times(pattern, density * plant.ringing_frequency)
    times = np.concatenate([k * pattern.period + within for k in range(abs(steps))])
    times = np.append(times, abs(steps) * pattern.period)
    s = simulation.sample(times)
    return Trace(times, s.x, s.v, s.u, s.z, s.v - s.rate, s.force)


def _sample_times(pattern: DriveCycle, rate: float) -> NDArray[np.float64]:
    """Return times (s) within a cycle at a rate (Hz), within bounds for each piece."""
    parts = []
    for start, end in pairwise(np.concatenate(([0.0], np.cumsum(pattern.durations)))):
        count = int(min(4000, max(100, rate * (end - start))))
        parts.append(np.linspace(start, end, count, endpoint=False))
    return np.concatenate(parts)


def write_csv(trace: Trace, file: TextIO) -> None:
    """Write one line for each sample, below a line of names with units."""
    writer = csv.writer(file)
    writer.writerow(HEADER)
    writer.writerows(np.column_stack([getattr(trace, f.name) for f in fields(trace)]).tolist())


def read_csv(path: Path) -> Trace:
    """Read a trace that `save_csv` wrote; ValueError if path holds none, OSError if not read."""
    try:
        with path.open(newline="", encoding="utf-8") as file:
            reader = csv.reader(file)
            if tuple(next(reader, ())) != HEADER:
                raise ValueError(f"its first line has to be {','.join(HEADER)}")
            return Trace(*np.array([[float(x) for x in row] for row in reader], ndmin=2).T)
    except (ValueError, TypeError, csv.Error) as error:
        raise ValueError(f"{path} holds no trace as simulate --trace writes it: {error}") from None


def save_csv(trace: Trace, path: Path) -> None:
    """Write the trace to path, all of it or nothing; WriteError if that cannot be."""
    with whole_file(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        write_csv(trace, file)
