# SPDX-License-Identifier: Apache-2.0
"""The registry of friction laws. A new one is a file beside this one and a line in `LAWS`.

A law of the form of `Contact` defines only its constants; the solver has closed forms and series
for it. A law of another form has its own ``rate``, with one state or two, which the solver
integrates by explicit steps. ``rows`` are the constants that only this law has.

This room loads neither numba nor numpy, because the table of parameters needs it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from stickslip_ros.laws.ceim import CEIM, CEIM_WITHOUT_MU
from stickslip_ros.laws.ceim_ageing import CEIM_AGEING
from stickslip_ros.laws.law import LEFT_TO_LAW, Law, smaller, value_or
from stickslip_ros.laws.lugre import EPM_CALC, EPM_FIX, LUGRE
from stickslip_ros.parameters import FrictionParameters, register

#: Friction laws by the name that the parameter ``model`` takes.
LAWS: Mapping[str, Law] = {
    "ceim": CEIM,
    "ceim_without_mu": CEIM_WITHOUT_MU,
    "ceim_ageing": CEIM_AGEING,
    "lugre": LUGRE,
    "epm_fix": EPM_FIX,
    "epm_calc": EPM_CALC,
}

_ROWS = tuple(dict.fromkeys(law.rows for law in LAWS.values() if law.rows))
for _rows in _ROWS:
    register("friction", _rows)

#: The constants that laws have alone, whole numbers and switches as well: fields of the record
#: that `Law.rate` takes. Texts are for `Law.constants` and `Law.contact` alone.
_OWN = tuple(
    (rows, one.name) for rows in _ROWS for one in fields(rows) if "pattern" not in one.metadata
)
OWN_CONSTANTS = tuple(name for _, name in _OWN)


def own_constants(c: FrictionParameters) -> tuple[Any, ...]:
    """Return the values of OWN_CONSTANTS, nan where one is not set; of columns arrays (points,)."""
    return tuple(value_or(getattr(c.own(rows), name), math.nan) for rows, name in _OWN)


__all__ = [
    "LAWS",
    "LEFT_TO_LAW",
    "OWN_CONSTANTS",
    "Law",
    "own_constants",
    "smaller",
    "value_or",
]
