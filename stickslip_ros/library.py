# SPDX-License-Identifier: Apache-2.0
"""The name of `simulation` before 2.0.0, with a warning."""

import warnings
from typing import Any

from stickslip_ros import simulation

__all__ = simulation.__all__


def __getattr__(name: str) -> Any:
    found = getattr(simulation, name)
    warnings.warn(
        f"stickslip_ros.library is stickslip_ros.simulation since 2.0.0: import {name} from there",
        FutureWarning,
        stacklevel=2,
    )
    return found
