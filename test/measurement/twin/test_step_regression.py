# SPDX-License-Identifier: Apache-2.0
"""The step after a change is the one that the readings show, whatever the model makes of it."""

import numpy as np
import pytest

from stickslip_ros.axis import Axis
from stickslip_ros.measurement.twin import Twin, TwinCommand


@pytest.mark.parametrize(
    ("amplitude", "frequency", "preload", "rate", "rest", "gain"),
    [
        (211.0, 239.0, 0.465, 56.0, 0.1, 1.045),  # 85.23 +- 0.07 nm was stated, 90.23 were made
        (187.0, 482.0, 0.427, 71.0, 0.1, 1.045),
        (174.0, 404.0, 0.591, 79.0, 0.15, 0.955),
    ],
)
def test_a_step_after_a_change_is_within_its_interval(
    amplitude: float, frequency: float, preload: float, rate: float, rest: float, gain: float
) -> None:
    axis = Axis({"amplitude": amplitude, "frequency": frequency, "preload": preload})
    twin, random = Twin(axis.parameters), np.random.default_rng(1)
    begin, number, went = 0.0, 0, 0.0
    for run, steps in enumerate((120, -150, 90, -130, 160, -140)):
        if run == 3:
            axis.command("parameters", {"gain": gain * axis.parameters.actuator.gain})
        axis.command("steps", steps)
        twin.command(TwinCommand(begin, "steps", steps))
        end, start = begin + abs(steps) / frequency + rest, axis.state.x
        while (at := 0.0031 + number / rate) < end:
            axis.advance(at)
            twin.measure(at, axis.state.x + 2e-9 * random.standard_normal())
            number += 1
        axis.advance(end)
        begin, went = end, (axis.state.x - start) / steps
    twin.settle()
    (step,) = (one for one in twin.estimates() if one.name == "step size")
    assert step.low < -went < step.high
    assert step.high - step.low < 4e-3 * went
    assert twin.changes[-1].step_after == pytest.approx(step.value, rel=2e-3)
    ahead = twin.predict_steps(-1000)
    axis.command("steps", -1000)
    axis.advance(axis.state.t + 1000 / frequency + rest)
    assert ahead.low < axis.state.x < ahead.high
