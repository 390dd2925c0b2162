# SPDX-License-Identifier: Apache-2.0
"""The curves of a twin against the axis that they are of."""

import pytest

from stickslip_ros.axis import Axis
from stickslip_ros.measurement.twin.response import CycleCurve, parts_of_cycles, settled_step
from stickslip_ros.measurement.twin.timeline import OperatingPoint, Piece


@pytest.mark.parametrize(("amplitude", "frequency"), [(229.0, 271.0), (289.0, 1494.0)])
def test_a_move_from_rest_to_rest_is_as_long_as_that_of_the_axis(
    amplitude: float, frequency: float
) -> None:
    """At 1.5 kHz a slip begins within a period of the ringing, which the curve leaves out."""
    axis = Axis({"amplitude": amplitude, "frequency": frequency})
    begin, before = 0.1, 1
    for steps in (100, 80, -90):
        direction = 1 if steps > 0 else -1
        drive = OperatingPoint(amplitude, frequency, direction, before)
        curve, piece = CycleCurve.of(axis.parameters, drive), Piece(begin, drive, abs(steps))
        axis.advance(begin)
        start, end = axis.state.x, piece.end + 0.02
        axis.command("steps", steps)
        axis.advance(end)
        first, last = curve.at(*parts_of_cycles(piece, begin, end))
        assert last - first == pytest.approx(axis.state.x - start, abs=0.02e-9)
        assert settled_step(axis.parameters, drive) == pytest.approx(curve.step, abs=2e-12)
        begin, before = end + 0.1, direction
