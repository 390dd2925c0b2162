# SPDX-License-Identifier: Apache-2.0
"""Table 1, the one set for all figures, and Tables 4 and 5: what the paper gives in numbers."""

from __future__ import annotations

import math
from dataclasses import astuple

import numpy as np

from stickslip_ros.model import Plant
from stickslip_ros.model.guide import Geometry, forces_by_preload, preload_ratio
from stickslip_ros.paper.claim import Check, Result, extra, number
from stickslip_ros.paper.force import both
from stickslip_ros.paper.parameter_sets import (
    JOINT,
    TABLE_1,
    TABLE_1_VIBRATION,
    Set,
    columns,
    steps_and_backsteps,
)
from stickslip_ros.paper.preload import zero_preload

#: Of Table 4, which is missing from our copy: the values that Table 5 leads back to.
_MASS, _ALPHA, _PRELOAD = 3e-3, 0.5 * math.pi, 0.2
#: mN, A to F, and half of the last printed digit.
_PRINTED, _HALF_DIGIT = (74.3, 67.1, 74.3, 67.1, 155.1, 127.8), 0.05
#: How near the joint set has to come to each number.
_NEAR = 0.05


def _step_and_ringing(base: Set) -> tuple[float, float, float]:
    """Return step (m), backstep (% of the step) and ringing (Hz) of a set."""
    step, backstep = (float(values[0]) for values in steps_and_backsteps(base))
    return step, 100.0 * backstep / step, Plant.of(columns(base)).ringing_frequency


def table_1() -> Result:
    """Step size, backstep and vibration of Table 1 from all sets."""
    sets = [_step_and_ringing(base) for base in (TABLE_1, TABLE_1_VIBRATION, JOINT)]
    (step, share, ringing), (step_v, share_v, ringing_v), (step_j, share_j, ringing_j) = sets
    names = ("step size (m)", "backstep (% of step)", "ringing frequency (Hz)")
    return Result(
        checks=(
            number("step size", step, "m", 130e-9, joint=step_j),
            number("backstep", share, "% of step", 30.0, joint=share_j),
            number("vibration", ringing, "Hz", 4e3, joint=ringing_j),
            extra("step size, sigma_0 from the vibration (Eq. 11)", step_v, "m"),
            extra("backstep, the same", share_v, "% of step"),
            extra("vibration, the same", ringing_v, "Hz"),
        ),
        tables={"": dict(zip(names, np.array(sets).T, strict=True))},
    )


def joint_set() -> Result:
    """Seven numbers of four figures and a table from one set."""
    step, share, ringing = _step_and_ringing(JOINT)
    old, new = both()
    (constant, _), (linear, _), _ = new.highest
    (old_constant, _), (old_linear, _), _ = old.highest
    was = _step_and_ringing(TABLE_1)
    rows = (
        ("step size", "m", 130e-9, step, was[0]),
        ("backstep", "% of step", 30.0, share, was[1]),
        ("vibration", "Hz", 4e3, ringing, was[2]),
        ("preload at which the straight fall of the steps ends", "N", 5.0, zero_preload(JOINT),
         zero_preload(TABLE_1)),
        ("maximum of the force, constant stiffness, at", "N", 1.7, constant, old_constant),
        ("maximum of the force, linear stiffness, at", "N", 2.8, linear, old_linear),
        ("level of the force, linear over constant", "", 2.0, new.gain, old.gain),
    )  # fmt: skip
    printed, ours, before = (np.array([row[k] for row in rows]) for k in (2, 3, 4))
    return Result(
        checks=(
            *(number(what, value, unit, paper, within=_NEAR)
              for what, unit, paper, value, _ in rows),
            extra("largest deviation, joint set",
                  100.0 * float(np.max(np.abs(ours / printed - 1.0))), "%"),
            extra("largest deviation, Table 1",
                  100.0 * float(np.max(np.abs(before / printed - 1.0))), "%"),
        ),
        tables={"": {"paper": printed, "joint set": ours, "Table 1": before}},
    )  # fmt: skip


def guide() -> Result:
    """The six forces from geometry, mass, inclination and preload."""
    geometry = Geometry()
    forces = forces_by_preload(geometry, _MASS, _ALPHA, _PRELOAD)
    ours = 1e3 * np.array(astuple(forces))

    def printed(what: str, value: float, unit: str, paper: float, half_digit: float) -> Check:
        return number(what, value, unit, paper, within=half_digit / paper)

    return Result(
        checks=(
            *(
                printed(name, float(value), "mN", paper, _HALF_DIGIT)
                for name, value, paper in zip("ABCDEF", ours, _PRINTED, strict=True)
            ),
            printed("sum of the normal forces", forces.total, "N", 0.566, 5e-4),
            printed("sum over preload", preload_ratio(forces, _PRELOAD), "", 2.8, 0.05),
            extra("(a - b) / (2 e)", geometry.lever),
        ),
        tables={"": {"ours (mN)": ours, "printed (mN)": np.array(_PRINTED)}},
    )
