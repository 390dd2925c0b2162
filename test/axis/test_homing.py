# SPDX-License-Identifier: Apache-2.0
"""Home: the reference is found, positions count from it, and what fails is said."""

import pytest
from table_1 import TABLE_1

from stickslip_ros.axis import Axis, CommandRefused

FAST = {**TABLE_1, "frequency": 1000.0, "travel_low": -2e-6, "travel_high": 3e-6}


def _away(**changes: object) -> Axis:
    """Return an axis that counts from 1 um."""
    axis = Axis({**FAST, **changes})
    axis.command("position", 1e-6)
    axis.advance(1.0)
    axis.command("stop")
    axis.advance(1.1)
    axis.command("zero")
    return axis


@pytest.mark.parametrize("where", ["mark", "low", "high"])
def test_positions_count_from_the_reference(where: str) -> None:
    axis = _away(home=where, home_mark=4e-7)
    axis.command("home")
    assert axis.status.state == "homing"
    axis.advance(3.0)
    place = {"mark": 4e-7, "low": -2e-6, "high": 3e-6}[where]
    assert (axis.status.state, axis.status.fault, axis.status.zero_offset) == ("stopped", "", 0.0)
    assert axis.status.position == pytest.approx(axis.state.x, abs=3e-9)
    assert axis.state.x == pytest.approx(place, abs=4e-9 if where == "mark" else 2e-7)
    assert [e.outcome for e in axis.take_events() if e.name == "home"] == ["applied", "finished"]


def test_what_ends_the_way_home_leaves_the_positions_as_they_were() -> None:
    for end in (
        lambda a: a.command("stop"),
        lambda a: a.command("steps", 0),
        lambda a: a.command("jog", 0.0),
    ):
        axis = _away(home_mark=-1e-6)
        axis.command("home")
        axis.advance(1.102)
        end(axis)
        axis.advance(1.2)
        assert (axis.status.state, axis.status.zero_offset > 0.0) == ("stopped", True)


def test_a_reference_that_cannot_be_reached_is_refused_or_a_fault() -> None:
    with pytest.raises(CommandRefused, match="which is home, lies at"):
        _away(home="low", soft_low=-2.5e-6).command("home")
    with pytest.raises(CommandRefused, match="choose one in this range"):
        _away(home_mark=5e-6).command("home")
    axis = _away(home="high", allow_faults=True, target_timeout=0.5)
    axis.command("parameters", {"fault": "axis_stuck"})
    axis.command("home")
    axis.advance(3.0)
    assert axis.status.state == "fault" and "which is home" in axis.status.fault
    with pytest.raises(CommandRefused, match="reset it first"):
        axis.command("home")
