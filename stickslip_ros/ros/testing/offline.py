# SPDX-License-Identifier: Apache-2.0
"""An axis without ROS for tests: time passes when the test says so, and at once."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from stickslip_ros.axis import Axis


class OfflineAxis:
    """A `stickslip_ros.axis.Axis` (:attr:`axis`) with all that it has, and a clock of its own."""

    def __init__(self, parameters: Mapping[str, Any]) -> None:
        """Set up the axis at rest, at time 0; ParameterError if the parameters do not make one."""
        self.axis = Axis(parameters)

    def run(self, seconds: float) -> None:
        """Let a time (s) pass."""
        self.axis.advance(self.axis.state.t + seconds)

    def __getattr__(self, name: str) -> Any:
        """Return what the axis has: commands, status, state, parameters."""
        if name in ("advance", "advance_to"):  # which took a duration until 3.0.0, and a time
            raise AttributeError(f"no {name} here: run(seconds), or axis.advance(t) to a time")
        return getattr(self.axis, name)
