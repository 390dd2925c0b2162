# SPDX-License-Identifier: Apache-2.0
"""The states of an axis, the states in which a command is allowed, and the status of an axis.

`commands.py` defines what each command does in each state. `docs/states.md` shows this as a table,
and as a diagram the transitions without a command (a move ends, a target is reached, a fault).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

STOPPED, STEPPING, JOGGING, SCANNING = "stopped", "stepping", "jogging", "scanning"
TARGETING, HOLDING, FAULT, DISABLED = "targeting", "holding", "fault", "disabled"
STATES = (STOPPED, STEPPING, JOGGING, SCANNING, TARGETING, HOLDING, FAULT, DISABLED)

#: In place of a next state: the command leaves the state as it is, or is refused.
SAME, REFUSED = "same", "refused"

#: State -> next state, `SAME` or `REFUSED`. A running cycle is finished first.
Row = Mapping[str, str]


def row(active: str, fault: str = REFUSED, disabled: str = REFUSED, **others: str) -> Row:
    """Return the effect of a command in each state.

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


@dataclass(frozen=True)
class AxisStatus:
    """A snapshot. Positions are as measured, counted from the zero that was set, if not said."""

    state: str  #: one of `STATES`
    moving: bool  #: cycles or a ramp are running
    enabled: bool
    paused: bool  #: the time of the axis stands still
    fault: str  #: reason of the fault; empty if there is none
    # -- steps
    steps_done: int  #: of the present or last run of cycles, with sign
    steps_left: int  #: of the present run, with sign; 0 for a jog
    step_count: int  #: all cycles since the start, those to -x taken off: commanded, not measured
    amplitude: float  #: commanded, V
    stroke: float  #: of the actuator at that amplitude, m
    frequency: float  #: commanded, Hz; of a jog its own
    last_step: float  #: displacement over the last cycle, m; nan before the first
    mean_step: float  #: mean over the present or last run, m; nan before its first step
    backstep: float  #: of the last slip, m; nan before the first
    lost: float  #: energy lost in the contact over the last cycle, J; nan before the first
    # -- position
    position: float  #: reading of the sensor, m
    zero_offset: float  #: subtracted from the reading, m
    velocity: float  #: mean over the last 10 ms, m/s
    scan_level: float  #: level of the actuator without the drive cycles, V
    load: float  #: external force along the axis, N
    # -- closed loop
    target: float  #: where the closed loop wants to be now, m; nan in open loop
    target_reached: bool
    following_error: float  #: target less position, m; nan in open loop
    # -- limits and refusals
    limits_hit: int  #: ends of the travel and soft limits hit since the start
    held_at: str  #: "low" or "high" while the runner is held by that end of the travel
    injected: str  #: faults on demand that act, with commas; empty if there are none
    refused: int  #: commands refused since the start
    last_error: str  #: reason of the last refusal or fault
