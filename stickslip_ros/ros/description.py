# SPDX-License-Identifier: Apache-2.0
"""The description of an axis: what it is, its parameters, what its commands take."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus

from stickslip_ros import __version__
from stickslip_ros.axis import Axis
from stickslip_ros.parameters import PARAMETERS, Values
from stickslip_ros.ros.messages import diagnostic_status

_INT32 = 2**31


def description(node: str, axis: Axis) -> list[DiagnosticStatus]:
    """Return the statuses ``<node>: description``, ``: parameter <name>``, ``: command <name>``."""
    p = axis.parameters
    name = p["axis_name"]
    joints = [f"{name}_slider", f"{name}_piezo", f"{name}_contact"]
    about = {"version": __version__, "axis_name": name, "joints": joints}
    found = [_status(node, "description", "simulated stick-slip axis", about)]
    for row in PARAMETERS.values():
        values: dict[str, Any] = {"value": p[row.name]}
        if not isinstance(row.default, str | bool):
            values |= {"unit": row.unit, "low": row.low, "high": row.high}
        values["mutable"] = row.mutable
        found.append(_status(node, f"parameter {row.name}", row.description, values))
    for command, unit, low, high, text in _commands(p):
        limits = {"unit": unit, "low": low, "high": high}
        found.append(_status(node, f"command {command}", text, limits))
    return found


def _commands(p: Values) -> Iterator[tuple[str, str, float, float, str]]:
    """Yield name, unit, lowest and highest value, and meaning of each command with a number."""
    steps, volts = p["max_steps"] or _INT32 - 1, p["max_voltage"]
    low, high = p["min_frequency"], p["max_frequency"]
    yield "steps", "", -steps, steps, "steps, the sign is the direction"
    yield "amplitude", "V", 0.0, volts, "peak to peak, above 0"
    yield "frequency", "Hz", low, high, "of stepping; the slip has to fit into the cycle"
    yield "jog", "Hz", -high, high, "steps without end, the sign is the direction; 0 stops"
    yield "scan", "V", p["min_voltage"], volts, "level of the actuator, moved to without a slip"
    ends = max(p["travel_low"], p["soft_low"]), min(p["travel_high"], p["soft_high"])
    yield "position", "m", *ends, "target of the closed loop"
    row = PARAMETERS["force"]
    yield "load", "N", row.low, row.high, "external force along the axis"


def _status(node: str, name: str, text: str, values: dict[str, Any]) -> DiagnosticStatus:
    # An infinite bound has no place in a text that people read as a number.
    bare = {k: v for k, v in values.items() if not (isinstance(v, float) and math.isinf(v))}
    return diagnostic_status(f"{node}: {name}", DiagnosticStatus.OK, text, bare, node)
