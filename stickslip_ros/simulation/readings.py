# SPDX-License-Identifier: Apache-2.0
"""What the simulated sensor reads of a run of steps, and a motion behind its bandwidth."""

from __future__ import annotations

import csv
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.axis.sensor import (
    Sensor,
    SensorDynamics,
    has_bandwidth,
    samples_per_reading,
)
from stickslip_ros.base.files import whole_file
from stickslip_ros.physics.model import Plant
from stickslip_ros.physics.model.low_pass import LowPass
from stickslip_ros.physics.model.waveforms import command_of
from stickslip_ros.physics.parameters import Parameters
from stickslip_ros.physics.solver.driven import simulation_of
from stickslip_ros.simulation.motion import Motion

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
        LowPass(p.sensor, dt, float(motion.x[0])),
        LowPass(p.sensor, dt, 0.0),
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
