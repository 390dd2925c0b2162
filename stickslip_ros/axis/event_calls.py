# SPDX-License-Identifier: Apache-2.0
"""From the event of a command back to the call that gave it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from stickslip_ros.axis.named_files import is_digest

_PLAIN = ("stop", "reset", "zero")
_NAMED = {"enable": "enable", "load": "set_load"}


def call_of(name: str, details: Mapping[str, Any]) -> tuple[str, tuple[Any, ...]]:
    """Return the method of an axis and its arguments for a command noted as applied."""
    if name == "parameters":
        return "set_parameters", ({k: v for k, v in details.items() if not is_digest(k)},)
    if name == "trajectory":
        return "command_trajectory", (details["joints"], details["points"])
    if name in _PLAIN:
        return name, ()
    return _NAMED.get(name, f"command_{name}"), (details["value"],)
