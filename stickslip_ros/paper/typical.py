# SPDX-License-Identifier: Apache-2.0
"""Table 1, the joint set for all figures, and Tables 4 and 5: the printed numbers."""

from __future__ import annotations

import math
from dataclasses import astuple

import numpy as np

from stickslip_ros.model import Plant
from stickslip_ros.model.guide import Geometry, forces_by_preload, preload_ratio
from stickslip_ros.paper.claim import Result
from stickslip_ros.paper.parameter_sets import (
    JOINT,
    TABLE_1,
    TABLE_1_VIBRATION,
    Set,
    columns,
    steps_and_backsteps,
)
from stickslip_ros.paper.preload import zero_preload
from stickslip_ros.paper.stiffness import both

#: Mass (kg), inclination (rad) and preload (N) that Table 5 leads back to: Table 4 is missing from
#: our copy.
_MASS, _ALPHA, _PRELOAD = 3e-3, 0.5 * math.pi, 0.2
#: The printed values of the seven numbers of the joint set: m, %, Hz, N, N, N, and a ratio.
_SEVEN = (130e-9, 30.0, 4e3, 5.0, 1.7, 2.8, 2.0)
#: The printed forces A to F of Table 5, mN.
_PRINTED = (74.3, 67.1, 74.3, 67.1, 155.1, 127.8)


def _step_and_ringing(base: Set) -> tuple[float, float, float]:
    """Return step (m), backstep (% of the step) and ringing (Hz) of a set."""
    step, backstep = (float(values[0]) for values in steps_and_backsteps(base))
    return step, 100.0 * backstep / step, Plant.of(columns(base)).ringing_frequency


def table_1() -> Result:
    """Step size, backstep and vibration of Table 1 from all sets."""
    sets = [_step_and_ringing(base) for base in (TABLE_1, TABLE_1_VIBRATION, JOINT)]
    (step, share, ringing), (step_v, share_v, ringing_v), (step_j, share_j, ringing_j) = sets
    names = ("step size (m)", "backstep (% of step)", "ringing frequency (Hz)")
    values = {
        "step size": (step, step_j),
        "backstep": (share, share_j),
        "vibration": (ringing, ringing_j),
        "step size, sigma_0 from the vibration (Eq. 11)": step_v,
        "backstep, the same": share_v,
        "vibration, the same": ringing_v,
    }
    return Result(values, tables={"": dict(zip(names, np.array(sets).T, strict=True))})


def joint_set() -> Result:
    """Seven numbers of four figures and a table from one set."""
    step, share, ringing = _step_and_ringing(JOINT)
    old, new = both()
    (constant, _), (linear, _), _ = new.highest
    (old_constant, _), (old_linear, _), _ = old.highest
    was = _step_and_ringing(TABLE_1)
    values = {
        "step size": step,
        "backstep": share,
        "vibration": ringing,
        "preload at which the straight fall of the steps ends": zero_preload(JOINT),
        "maximum of the force, constant stiffness, at": constant,
        "maximum of the force, linear stiffness, at": linear,
        "level of the force, linear over constant": new.gain,
    }
    printed, ours = np.array(_SEVEN), np.array(list(values.values()))
    before = np.array([*was, zero_preload(TABLE_1), old_constant, old_linear, old.gain])
    values |= {
        f"largest deviation, {name}": 100.0 * float(np.max(np.abs(found / printed - 1.0)))
        for name, found in (("joint set", ours), ("Table 1", before))
    }
    return Result(values, tables={"": {"paper": printed, "joint set": ours, "Table 1": before}})


def guide() -> Result:
    """The six forces from geometry, mass, inclination and preload."""
    geometry = Geometry()
    forces = forces_by_preload(geometry, _MASS, _ALPHA, _PRELOAD)
    ours = 1e3 * np.array(astuple(forces))

    values = {
        **dict(zip("ABCDEF", ours, strict=True)),
        "sum of the normal forces": forces.total,
        "sum over preload": preload_ratio(forces, _PRELOAD),
        "(a - b) / (2 e)": geometry.lever,
    }
    table = {"ours (mN)": ours, "printed (mN)": np.array(_PRINTED)}
    return Result(values, tables={"": table})
