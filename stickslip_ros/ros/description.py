# SPDX-License-Identifier: Apache-2.0
"""The description of an axis: what it is, its parameters, what its commands take."""

from __future__ import annotations

import math
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus

from stickslip_ros import __version__
from stickslip_ros.axis import Axis
from stickslip_ros.axis.commands import COMMANDS
from stickslip_ros.parameters import PARAMETERS
from stickslip_ros.ros.messages import diagnostic_status


def description(node: str, axis: Axis) -> list[DiagnosticStatus]:
    """Return the statuses ``<node>: description``, ``: parameter <name>``, ``: command <name>``."""
    p = axis.parameters
    flat, name = p.flat(), p.node.axis_name
    joints = [f"{name}_slider", f"{name}_piezo", f"{name}_contact"]
    about = {"version": __version__, "axis_name": name, "joints": joints}
    found = [_status(node, "description", "simulated stick-slip axis", about)]
    for row in PARAMETERS.values():
        values: dict[str, Any] = {"value": flat[row.name]}
        if row.kind not in (str, bool):
            values |= {"unit": row.unit, "low": row.low, "high": row.high}
        values["mutable"] = row.mutable
        found.append(_status(node, f"parameter {row.name}", row.description, values))
    for command in COMMANDS.values():
        if command.limits:
            low, high = command.limits(p)
            limits = {"unit": command.unit, "low": low, "high": high}
            found.append(_status(node, f"command {command.name}", command.meaning, limits))
    return found


def _status(node: str, name: str, text: str, values: dict[str, Any]) -> DiagnosticStatus:
    # An infinite bound has no place in a text that people read as a number.
    bare = {k: v for k, v in values.items() if not (isinstance(v, float) and math.isinf(v))}
    return diagnostic_status(f"{node}: {name}", DiagnosticStatus.OK, text, bare, node)
