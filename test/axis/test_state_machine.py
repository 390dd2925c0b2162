# SPDX-License-Identifier: Apache-2.0
"""Every command in every state: the table, the page about it and an axis agree."""

from collections.abc import Callable
from pathlib import Path

import pytest
from table_1 import TABLE_1

from stickslip_ros.axis import Axis, CommandRefused
from stickslip_ros.axis.command import REFUSED, SAME, STATES
from stickslip_ros.axis.commands import COMMANDS, state_table

TABLE = state_table()
PAGE = Path(__file__).resolve().parents[2] / "docs" / "states.md"


def _send(axis: Axis, row: str) -> None:
    """Send the command of a row of the table: its example, or 0 or False where it is turned off."""
    for command in COMMANDS.values():
        if row == command.name:
            axis.command(row, *command.example)
        elif command.off and row == command.off[0]:
            axis.command(command.name, type(command.example[0])(0))


def _axis_in(state: str) -> Axis:
    """Return an axis that has been in a state for some time, in the midst of a cycle if it steps.

    Scans take their time, so that the axis still scans when it is looked at.
    """
    axis = Axis({**TABLE_1, "frequency": 1000.0, "scan_rate": 500.0})
    prepare: dict[str, Callable[[], None]] = {
        "stopped": lambda: None,
        "stepping": lambda: axis.command("steps", -100_000),
        "jogging": lambda: axis.command("jog", 1100.0),
        "scanning": lambda: axis.command("scan", 300.0),
        "targeting": lambda: axis.command("position", -1e-3),
        "holding": lambda: axis.command("position", 2e-8),
        "homing": lambda: _go_home(axis),
        "fault": lambda: _break(axis),
        "disabled": lambda: axis.command("enable", False),
    }
    prepare[state]()
    axis.advance(axis.state.t + 0.3037)
    assert axis.status.state == state
    return axis


def _go_home(axis: Axis) -> None:
    axis.command("parameters", {"home_mark": -1e-3})
    axis.command("home")


def _break(axis: Axis) -> None:
    axis.command("parameters", {"max_velocity": 1e-6})
    axis.command("jog", 100.0)
    axis.advance(0.1)
    axis.command("parameters", {"max_velocity": 0.0})


@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("command", TABLE)
def test_a_command_leads_where_the_table_says(command: str, state: str) -> None:
    """At the end of the cycle that runs; a refusal changes nothing and names the cure."""
    axis = _axis_in(state)
    after = TABLE[command][state]
    if after == REFUSED:
        with pytest.raises(CommandRefused, match=r"reset it first|enable it first|stop it first"):
            _send(axis, command)
        assert axis.status.refused == 1
    else:
        _send(axis, command)
        assert axis.status.refused == 0
    axis.advance(axis.state.t + 0.003)
    assert axis.status.state == (state if after in (SAME, REFUSED) else after)


def test_what_the_page_says_is_in_force() -> None:
    page = PAGE.read_text(encoding="utf-8")
    table = page.split("<!-- end -->")[0].split("tables.py -->")[1].strip()
    head, _, *rows = (
        [cell.strip() for cell in line[1:-1].split("|")] for line in table.split("\n")
    )
    assert head == ["command", *STATES]
    documented = {name: dict(zip(STATES, states, strict=True)) for name, *states in rows}
    assert len(documented) >= 17
    assert documented.items() <= TABLE.items()


def test_enabled_without_a_reset_it_is_in_fault_again() -> None:
    axis = _axis_in("fault")
    reason = axis.status.fault
    axis.command("enable", False)
    axis.command("enable", True)
    assert (axis.status.state, axis.status.fault) == ("fault", reason)
    axis.command("enable", False)
    axis.command("reset")
    axis.command("enable", True)
    assert (axis.status.state, axis.status.fault) == ("stopped", "")


@pytest.mark.parametrize("end", [("stop",), ("enable", False)])
def test_steps_end_after_their_cycle(end: tuple[object, ...]) -> None:
    axis = _axis_in("stepping")
    done = axis.status.steps_done
    axis.command(str(end[0]), *end[1:])
    running = axis.moving
    axis.advance(axis.state.t + 0.01)
    assert (running, axis.moving) == (True, False)
    assert axis.status.steps_done == done - 1
    assert axis.status.scan_level == 0.0


def test_a_scan_ends_where_it_is() -> None:
    axis = _axis_in("scanning")
    level = axis.status.scan_level
    axis.command("stop")
    assert not axis.moving
    axis.advance(axis.state.t + 1.0)
    assert axis.status.scan_level == level == pytest.approx(0.3037 * 500.0)
