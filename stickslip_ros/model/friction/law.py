# SPDX-License-Identifier: Apache-2.0
"""What a friction law is made of: its own constants, and the contact that follows from them.

A law is arithmetic on parameters, and arithmetic is the same for numbers and for columns of them,
arrays (points,). Only choices are not; with `value_or` and `smaller` a law is written once for
both.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from stickslip_ros.model.friction.contact import Contact
from stickslip_ros.parameters import FrictionParameters


class Constants(NamedTuple):
    """Constants in force: as the parameters set them, else the law's own; None if it has none."""

    sigma_0: Any = None  #: N/m
    sigma_0ss: Any = None  #: N/m
    z_ba: Any = None  #: m
    z_ss: Any = None  #: m


class Law(NamedTuple):
    """A friction law. Constants and contact follow from the parameters and the normal force (N)."""

    constants: Callable[[FrictionParameters, Any], Constants]
    contact: Callable[[FrictionParameters, Any], Contact]
    #: Compiled, z' (m/s) from z (m), w (m/s) and the contact: of a law that is not of the form of
    #: `Contact`. It is odd in (z, w) and smooth while w keeps its sign.
    rate: Callable[[float, float, Contact], float] | None = None


def value_or(value: Any, own: Any) -> Any:
    """Return value where it is set, own where it is None or, in a column, nan."""
    if isinstance(value, np.ndarray):
        return np.where(np.isnan(value), own, value)
    return own if value is None else value


def smaller(a: Any, b: Any) -> Any:
    """Return the smaller of two values, element by element if one is an array."""
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return np.minimum(a, b)
    return min(a, b)
