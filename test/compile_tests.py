# SPDX-License-Identifier: Apache-2.0
"""Compiles the package, or with an argument the tests' integrators, for all that run after it.

The two share no compiled code, so two processes compile both in the time of one.
"""

import sys

from bench_traces import Axis, Drive, Sensor, bench_trace

import stickslip_ros as ss
from validation.whole_system import positions


def _integrators() -> None:
    positions(ss.Parameters.of({"frequency": 1e4}), 1)


if __name__ == "__main__":
    if sys.argv[1:]:
        _integrators()
    else:
        ss.warm_up()
        bench_trace(Axis(), (Drive(1, frequency=1e4),), Sensor(), rest=1e-4)
