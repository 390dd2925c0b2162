# SPDX-License-Identifier: Apache-2.0
"""The states of an axis and what each command does in each of them: one table.

`docs/states.md` shows the same table and a drawing of it. What a state does on its own (a move
that ends, a target that is reached, a fault) stands in the drawing.
"""

from __future__ import annotations

STOPPED, STEPPING, JOGGING, SCANNING = "stopped", "stepping", "jogging", "scanning"
TARGETING, HOLDING, FAULT, DISABLED = "targeting", "holding", "fault", "disabled"
STATES = (STOPPED, STEPPING, JOGGING, SCANNING, TARGETING, HOLDING, FAULT, DISABLED)

#: In place of a next state: the command changes no state, or is refused.
SAME, REFUSED = "same", "refused"


def _row(active: str, fault: str = REFUSED, disabled: str = REFUSED) -> dict[str, str]:
    """Return state -> next state; ``active`` holds in all states but the last two."""
    return {**dict.fromkeys(STATES, active), FAULT: fault, DISABLED: disabled}


#: Command -> state -> next state. A running cycle is finished first.
TABLE: dict[str, dict[str, str]] = {
    "steps": _row(STEPPING),
    "steps 0": _row(STOPPED),
    "jog": _row(JOGGING),
    "jog 0": _row(STOPPED),
    "scan": _row(SCANNING),
    "position": _row(TARGETING),
    "trajectory": _row(TARGETING),
    "amplitude": _row(SAME),
    "frequency": _row(SAME),
    "stop": _row(STOPPED, fault=SAME, disabled=SAME),
    "zero": {**_row(REFUSED), STOPPED: SAME},
    "load": _row(SAME, fault=SAME, disabled=SAME),
    "parameters": _row(SAME, fault=SAME, disabled=SAME),
    "reset": _row(SAME, fault=STOPPED, disabled=SAME),
    "enable": _row(SAME, fault=SAME, disabled=STOPPED),
    "disable": _row(DISABLED, fault=DISABLED, disabled=SAME),
}


def refusal(command: str, state: str, fault: str) -> str:
    """Return why a command is refused in a state, empty if it is not; fault: its reason."""
    if TABLE[command][state] != REFUSED:
        return ""
    if state == FAULT:
        return f"the axis is in fault ({fault}): reset it first"
    if state == DISABLED:
        return "the axis is disabled: enable it first"
    return f"the axis is {state}: stop it first"
