# SPDX-License-Identifier: Apache-2.0
"""Compiles the package and the integrators of the tests, for all that run tests after it."""

from bench_traces import Axis, Drive, Sensor, bench_trace

import stickslip_ros as ss
from stickslip_ros.model import Plant, drive_of
from validation.benchmark import judge
from validation.benchmark.reference import displacement_from_rest
from validation.whole_system import positions

if __name__ == "__main__":
    ss.warm_up()
    p = ss.Parameters.of({"frequency": 1e4})
    bench_trace(Axis(), (Drive(1, frequency=1e4),), Sensor(), rest=1e-4)
    displacement_from_rest(Plant.of(p), drive_of(p), 1)
    judge.positions(Plant.of(p), drive_of(p), 1)
    positions(p, 1)
