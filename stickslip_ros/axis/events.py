# SPDX-License-Identifier: Apache-2.0
"""What happened to an axis, and the refusal of a command."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any


class CommandRefused(ValueError):
    """A command that the axis does not carry out; the message names the value and the limit."""


@dataclass(frozen=True)
class Event:
    """Something a later run has to know to repeat this one, or a user to understand it."""

    time: float  #: s since the start of the simulation
    name: str  #: what it is about, such as "steps"
    outcome: str  #: "applied", "refused", "finished", "hit" or "fault"
    details: dict[str, Any] = field(default_factory=dict)
