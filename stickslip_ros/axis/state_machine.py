# SPDX-License-Identifier: Apache-2.0
"""The states of an axis, and the states in which a command is allowed.

`commands.py` defines what each command does in each state. `docs/states.md` shows this as a table,
and as a diagram the transitions without a command (a move ends, a target is reached, a fault).
"""

from __future__ import annotations

from collections.abc import Mapping

STOPPED, STEPPING, JOGGING, SCANNING = "stopped", "stepping", "jogging", "scanning"
TARGETING, HOLDING, FAULT, DISABLED = "targeting", "holding", "fault", "disabled"
STATES = (STOPPED, STEPPING, JOGGING, SCANNING, TARGETING, HOLDING, FAULT, DISABLED)

#: In place of a next state: the command leaves the state as it is, or is refused.
SAME, REFUSED = "same", "refused"

#: State -> next state, `SAME` or `REFUSED`. A running cycle is finished first.
Row = Mapping[str, str]


def row(active: str, fault: str = REFUSED, disabled: str = REFUSED, **others: str) -> Row:
    """Return what a command does in each state.

    ``active`` holds in all states but fault, disabled and those named in ``others``.
    """
    return {**dict.fromkeys(STATES, active), FAULT: fault, DISABLED: disabled, **others}


def refusal(row: Row, state: str, fault: str) -> str:
    """Return why a command is refused in a state, empty if it is not; fault: its reason."""
    if row[state] != REFUSED:
        return ""
    if state == FAULT:
        return f"the axis is in fault ({fault}): reset it first"
    if state == DISABLED:
        return "the axis is disabled: enable it first"
    return f"the axis is {state}: stop it first"
