# SPDX-License-Identifier: Apache-2.0
"""The registry of friction laws. A new one is a file beside this one and a line in `LAWS`.

A law of the form of `Contact` is nothing but its constants, and closed forms and series of the
solver serve it. One of another form brings its own ``rate``, of one state or two; the solver then
takes its general way. What constants a law alone has, it brings as ``rows``.

This room loads neither numba nor numpy: the table of parameters is made with it.
"""

from __future__ import annotations

from collections.abc import Mapping

from stickslip_ros.laws.ceim import CEIM, CEIM_WITHOUT_MU
from stickslip_ros.laws.elastoplastic import EPM_CALC, EPM_FIX
from stickslip_ros.laws.law import Constants, Law, smaller, value_or
from stickslip_ros.laws.lugre import LUGRE
from stickslip_ros.parameters import register

#: Friction laws by the name that the parameter ``model`` takes.
LAWS: Mapping[str, Law] = {
    "ceim": CEIM,
    "ceim_without_mu": CEIM_WITHOUT_MU,
    "lugre": LUGRE,
    "epm_fix": EPM_FIX,
    "epm_calc": EPM_CALC,
}

for _law in LAWS.values():
    if _law.rows is not None:
        register("friction", _law.rows)

__all__ = ["LAWS", "Constants", "Law", "smaller", "value_or"]
