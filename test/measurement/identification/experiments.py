# SPDX-License-Identifier: Apache-2.0
"""Synthetic experiments: traces of the independent integrator, and starting values that are off."""

from collections.abc import Mapping

from bench_traces import Axis, Drive, Sensor, bench_trace

from stickslip_ros.physics.parameters import Parameters
from stickslip_ros.simulation.motion import Motion

#: Starting values over true ones.
WRONG = {"sigma_0": 2.5, "sigma_1": 0.4, "z_ba": 2.0, "sigma_0ss": 0.4}


def truth_of(axis: Axis) -> dict[str, float]:
    """What an identification at one preload should find."""
    _, sigma_0, sigma_1, z_ba, _, _ = axis.constants
    return {"sigma_0": sigma_0, "sigma_1": sigma_1, "z_ba": z_ba, "sigma_0ss": axis.sigma_0ss}


def experiment(
    axis: Axis,
    drive: Drive,
    sensor: Sensor,
    seed: int = 0,
    wrong: Mapping[str, float] = WRONG,
    rest: float = 4e-3,
) -> tuple[Parameters, Motion]:
    """What is known of a drive, and the trace that it made."""
    bench = bench_trace(axis, (drive,), sensor, rest, seed)
    known = {
        "preload": axis.preload,
        "mass": axis.mass,
        "frequency": drive.frequency,
        "amplitude": drive.amplitude,
        "slewrate": 1e-6 * drive.slewrate,
    }
    start = {name: value * wrong[name] for name, value in truth_of(axis).items() if name in wrong}
    return Parameters.of({**known, **start}), Motion("bench", bench.t, bench.x)


def small(seed: int = 3) -> tuple[Axis, tuple[Parameters, Motion]]:
    """An axis, and ten quick cycles of it."""
    axis = Axis(preload=0.5, mass=5e-3, sigma_1=7.0, sigma_0ss=1.2e7)
    drive = Drive(10, frequency=800.0, amplitude=250.0, pause=5e-3)
    return axis, experiment(axis, drive, Sensor(rate=5e5, noise=1e-9, zero=2e-7), seed)


def holds(low: float | None, value: float, high: float | None) -> bool:
    """Whether an interval holds a value."""
    return (low is None or low <= value) and (high is None or value <= high)
