# SPDX-License-Identifier: Apache-2.0
"""Tables 4 and 5: the six contact forces of the guide (Appendix)."""

from __future__ import annotations

import math
from dataclasses import astuple

import numpy as np

from stickslip_ros.model.guide import Geometry, forces_by_preload, preload_ratio
from stickslip_ros.paper.item import Check, Item, Kind, Result

#: Of Table 4, which is missing from our copy: the values that Table 5 leads back to.
_MASS, _ALPHA, _PRELOAD = 3e-3, 0.5 * math.pi, 0.2
#: mN, A to F, and half of the last printed digit.
_PRINTED, _HALF_DIGIT = (74.3, 67.1, 74.3, 67.1, 155.1, 127.8), 0.05


def compute() -> Result:
    """The forces from geometry, mass, inclination and preload."""
    geometry = Geometry()
    forces = forces_by_preload(geometry, _MASS, _ALPHA, _PRELOAD)
    ours = 1e3 * np.array(astuple(forces))

    def printed(what: str, ours: float, unit: str, paper: float, half_digit: float) -> Check:
        low, high = paper - half_digit, paper + half_digit
        return Check(what, ours, unit, f"{paper:g}", low, high, Kind.NUMBER)

    return Result(
        checks=(
            *(
                printed(name, float(value), "mN", paper, _HALF_DIGIT)
                for name, value, paper in zip("ABCDEF", ours, _PRINTED, strict=True)
            ),
            printed("sum of the normal forces", forces.total, "N", 0.566, 5e-4),
            printed("sum over preload", preload_ratio(forces, _PRELOAD), "", 2.8, 0.05),
            Check("(a - b) / (2 e)", geometry.lever, kind=Kind.OURS),
        ),
        tables={"": {"ours (mN)": ours, "printed (mN)": np.array(_PRINTED)}},
        remark=(
            "Table 4, with the conditions behind these numbers, is missing from our copy of the "
            "paper. A runner of 3 g, a level axis, a preload of 0.2 N and (a - b) / (2 e) = 0.9276 "
            "give every printed digit; other lengths of the geometry have no bearing on it. Rows "
            "of the CSV: A to F."
        ),
    )


ITEM = Item(
    name="tab05",
    title="Contact forces of a prismatic guide",
    place="Appendix, Eq. 17 to 31, Tables 4 and 5",
    statement=(
        "Six contacts hold the runner; with friction proportional to the normal force and the "
        "preload as one equation, the six normal forces follow. Their sum is 2.8 times the preload "
        "that a load cell reads."
    ),
    setup="Eq. 30, 31 with 3 g, a level axis and 0.2 N.",
    compute=compute,
)
