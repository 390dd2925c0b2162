# SPDX-License-Identifier: Apache-2.0
"""The motion of a runner over time: simulated, recorded, measured, or as a sensor sees it."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import scipy  # its parts load when they are used, which takes half a second
from numpy.typing import NDArray

from stickslip_ros.axis.sensor import (
    Sensor,
    SensorDynamics,
    has_bandwidth,
    low_pass_of,
    samples_per_reading,
)
from stickslip_ros.files import whole_file
from stickslip_ros.model import Plant
from stickslip_ros.model.waveforms import command_of
from stickslip_ros.parameters import Parameters
from stickslip_ros.reporting import SIMULATED, draw_lines, format_si, html_table
from stickslip_ros.reporting.tables import frame
from stickslip_ros.reporting.terminal import format_rows
from stickslip_ros.solver.driven import simulation_of
from stickslip_ros.traces.trace import Trace

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes


@dataclass(frozen=True, repr=False)
class Motion:
    """Position over strictly increasing time; every array has the shape (samples,)."""

    source: str  #: where it comes from, for people
    t: NDArray[np.float64]  #: time, s
    x: NDArray[np.float64]  #: runner position, m
    v: NDArray[np.float64] | None = None  #: runner velocity, m/s, where it is known exactly
    u: NDArray[np.float64] | None = None  #: actuator deflection, m
    notes: tuple[str, ...] = ()  #: remarks of the reader, for people

    @classmethod
    def of_trace(cls, trace: Trace, source: str) -> Motion:
        """Return the motion of runner and actuator in a trace."""
        return cls(source, trace.t, trace.x, trace.v, trace.u)

    @cached_property
    def spacing(self) -> float:
        """Median time (s) between samples."""
        return float(np.median(np.diff(self.t)))

    @property
    def duration(self) -> float:
        """Time (s) from the first sample to the last."""
        return float(self.t[-1] - self.t[0])

    def position_at(self, t: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the position (m) at times (s) between the first and the last sample.

        Straight lines between samples, cubic ones where the velocity is known too.
        """
        if self._spline is None:
            return np.interp(t, self.t, self.x)
        return np.asarray(self._spline(np.clip(t, self.t[0], self.t[-1])))

    def velocity_at(self, t: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the velocity (m/s) at times (s), from differences where it is not known."""
        return np.interp(t, self.t, self._velocity)

    def to_frame(self) -> pandas.DataFrame:
        """Return a table with one row for each sample, SI units; needs pandas."""
        columns = {"time (s)": self.t, "position (m)": self.x}
        if self.u is not None:
            columns["actuator (m)"] = self.u
        return frame(columns, "sample")

    def plot(self, axes: Axes | None = None) -> Axes:
        """Draw the position over time into axes of Matplotlib, or new ones; return them."""
        lines = [(self.t, self.x, "-", SIMULATED, "position")]
        return draw_lines(axes, lines, "time (s)", "position (m)", self.source)

    def __repr__(self) -> str:
        """Say the motion in one line."""
        return f"Motion({self.source}: {len(self.t)} samples over {format_si(self.duration, 's')})"

    def report(self) -> str:
        """Return one line for each of samples, duration, first and last position, and notes."""
        return format_rows(self._rows())

    def _repr_html_(self) -> str:
        return html_table(self.source, self._rows())

    def _rows(self) -> list[tuple[str, str]]:
        return [
            ("samples", f"{len(self.t)}"),
            ("duration", format_si(self.duration, "s")),
            (
                "from, to",
                f"{format_si(float(self.x[0]), 'm')}, {format_si(float(self.x[-1]), 'm')}",
            ),
            *(("note", note) for note in self.notes),
        ]

    @cached_property
    def _spline(self) -> scipy.interpolate.CubicHermiteSpline | None:
        return (
            None if self.v is None else scipy.interpolate.CubicHermiteSpline(self.t, self.x, self.v)
        )

    @cached_property
    def _velocity(self) -> NDArray[np.float64]:
        return np.gradient(self.x, self.t) if self.v is None else self.v

    def between(self, start: float, end: float) -> Motion:
        """Return the samples from start to end (s), both included."""
        kept = slice(*np.searchsorted(self.t, [start, np.nextafter(end, np.inf)]))
        v = None if self.v is None else self.v[kept]
        u = None if self.u is None else self.u[kept]
        return Motion(self.source, self.t[kept], self.x[kept], v, u, self.notes)


_CHUNK = 2**18  # instants at a time
#: Names of the columns that a sensor fills
HEADER = ("time (s)", "position (m)")


def read_steps(p: Parameters, steps: int) -> Motion:
    """Simulate the readings of steps (sign: direction), with a rest before and after.

    Each rest takes a period of the drive, and 20 readings at least. Times (s) are those at which
    readings arrive, late by the latency of the sensor. Raises ParameterError.
    """
    plant, drive_cycle = Plant.of(p), command_of(p, 1 if steps >= 0 else -1)
    simulation = simulation_of(p, plant)
    sensor = Sensor(p.sensor)
    rest = math.ceil(max(drive_cycle.period * sensor.rate, 20.0))
    dynamics = None
    if has_bandwidth(p.sensor):
        dynamics = SensorDynamics(p.sensor, plant.ringing_frequency, 0.0, 0.0)

    def positions(times: NDArray[np.float64]) -> NDArray[np.float64]:
        if dynamics is None:
            return simulation.sample(times).x
        x = np.empty(len(times))
        for number, t in enumerate(times):
            for looks in dynamics.due(t):
                samples = simulation.sample(looks)
                dynamics.record(samples.x, samples.v)
            x[number] = dynamics.sensed
        return x

    before = positions(np.arange(rest + 1) / sensor.rate)  # a load moves the runner already
    simulation.start(drive_cycle, abs(steps))
    k = np.arange(sensor.number_at(simulation.end_of_move) + 1 + rest)
    x = np.append(before, positions(k[rest + 1 :] / sensor.rate))
    seen = [sensor.reading(*one) for one in zip(x.tolist(), k.tolist(), strict=True)]
    arrived = (k + sensor.delay) / sensor.rate
    return Motion(f"readings of {steps} steps", arrived, np.array(seen))


def save_readings(readings: Motion, path: Path) -> None:
    """Write time and position to path, all of it or nothing; WriteError if that cannot be."""
    with whole_file(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(HEADER)
        writer.writerows(np.column_stack([readings.t, readings.x]).tolist())


def through_bandwidth(p: Parameters, motion: Motion) -> Motion:
    """Filter a motion with the low-pass of the sensor, settled at its start, if there is one."""
    if not has_bandwidth(p.sensor) or motion.duration == 0.0:
        return motion
    looks = samples_per_reading(p.sensor, Plant.of(p).ringing_frequency)
    dt = 1.0 / (p.sensor.sensor_rate * looks)
    position, velocity = (
        low_pass_of(p.sensor, dt, float(motion.x[0])),
        low_pass_of(p.sensor, dt, 0.0),
    )
    x, v = np.empty_like(motion.x), np.empty_like(motion.x)
    done, first, last = 0, 0, math.ceil(motion.duration / dt) + 1
    ends = np.empty((3, 0))  # time, position and velocity at the last look
    while done < len(x):
        t = motion.t[0] + dt * np.arange(first, min(first + _CHUNK, last + 1))
        rate = motion.velocity_at(t)
        moved = position.filter(motion.position_at(t), rate)
        speed = velocity.filter(rate, np.gradient(rate, dt))
        known = np.concatenate([ends, [t, moved, speed]], axis=1)
        part = slice(done, int(np.searchsorted(motion.t, t[-1], side="right")))
        x[part] = np.interp(motion.t[part], known[0], known[1])
        v[part] = np.interp(motion.t[part], known[0], known[2])
        done, first, ends = part.stop, first + _CHUNK, known[:, -1:]
    return replace(motion, x=x, v=v)
