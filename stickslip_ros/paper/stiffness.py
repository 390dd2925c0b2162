# SPDX-License-Identifier: Apache-2.0
"""Fig. 10, 11 and 15: sigma_0 and the force with it; Tables 1, 4 and 5, the joint set."""

from __future__ import annotations

import math
from dataclasses import astuple
from typing import NamedTuple

import numpy as np

from stickslip_ros.arrays import Array
from stickslip_ros.measurement.steps.ringing import fit_ringing
from stickslip_ros.model import Plant, drive_of
from stickslip_ros.model.contacts import Geometry, forces_by_preload, preload_ratio
from stickslip_ros.model.derivations import (
    Elastic,
    sigma_0_of_asperities,
    sigma_0_of_mindlin,
    sigma_0_of_ringing,
)
from stickslip_ros.motion.sampling import trace_steps
from stickslip_ros.paper.claim import Result, Values, paired
from stickslip_ros.paper.materials import POISSON, RADIUS, RUBY, maximum, peaks, tops
from stickslip_ros.paper.parameter_sets import (
    EIGENFREQUENCY,
    JOINT,
    JOINT_CONSTANT,
    JOINT_SENSOR,
    STIFFNESS_OF_VIBRATION,
    TABLE_1,
    TABLE_1_VIBRATION,
    VIBRATION,
    Set,
    columns,
    forces,
    steps_and_backsteps,
)
from stickslip_ros.paper.step_curves import zero_preload

#: N; at each a step is traced and its ringing measured.
_PRELOAD = (0.1, 0.4, 1.0, 2.0)
#: The range of Table 3, N/m^2.
MODULUS = np.linspace(70e9, 600e9, 40)
#: Radius of the contact of one asperity, m: assumed, only its product with their number counts.
ASPERITY = 1e-6
#: Preloads of Fig. 15, N.
PRELOAD = np.linspace(0.2, 6.0, 117)
#: Constant stiffness with Table 1, N/m: p of Eq. 14, for the paper gives none.
CONSTANT = 7e6
#: Preload (N) from which Eq. 14 stays constant.
BOUND = 2.0


def mindlin(modulus: float, preload: float) -> float:
    """Return the stiffness (N/m) of the ball on a flat of a modulus (N/m^2), preload in N."""
    return sigma_0_of_mindlin(preload, RADIUS, Elastic(modulus, POISSON), RUBY)


def stiffness() -> Result:
    """Compare the stiffness recovered from simulated ringing with both theories."""
    recovered, given = [], []
    for preload in _PRELOAD:
        p = columns({"preload": preload})
        trace, period = trace_steps(p, 2), drive_of(p).period
        after = (trace.t >= period) & (trace.t < 1.9 * period)
        ringing = fit_ringing(trace.t[after] - period, trace.x[after], 0.9 * period)
        frequency = ringing.frequency if ringing else math.nan
        recovered.append(sigma_0_of_ringing(frequency, p.runner.mass))
        given.append(Plant.of(p).contact.sigma_0)
    smooth = {
        preload: np.array([mindlin(modulus, preload) for modulus in MODULUS.tolist()])
        for preload in (0.1, 1.0)
    }
    steel = mindlin(200e9, 1.0)
    one = np.array([sigma_0_of_asperities(1, ASPERITY, Elastic(e, POISSON)) for e in MODULUS])
    count = 1000.0 * steel / float(np.interp(200e9, MODULUS, one))
    rough = count * one
    error = float(np.max(np.abs(np.array(recovered) / np.array(given) - 1.0)))

    shown = np.linspace(0.0, 2.2, 20)
    values = {
        "largest error of sigma_0 from the ringing": 100.0 * error,
        "smooth contact at 1 N over Eq. 11 with 4 kHz": steel / STIFFNESS_OF_VIBRATION,
        "smooth contact, 600 over 70 kN/mm²": smooth[1.0][-1] / smooth[1.0][0],
        "smooth contact, 1 N over 0.1 N": smooth[1.0][0] / smooth[0.1][0],
        "asperities, 600 over 70 kN/mm²": rough[-1] / rough[0],
        "sigma_0 of the vibration between both theories": 0.5 * smooth[0.1][0]
        < STIFFNESS_OF_VIBRATION
        < rough[0],
        "asperities of 1 µm that put theory three decades higher": count,
        "Eq. 14 at 0.4 N over Eq. 11 with 4 kHz": 9e6 / STIFFNESS_OF_VIBRATION,
        "sigma_0 of Eq. 11 with 4 kHz": STIFFNESS_OF_VIBRATION,
    }
    table = {
        "preload (N)": np.array(_PRELOAD),
        "sigma_0 set (N/m)": np.array(given),
        "sigma_0 from ringing (N/m)": np.array(recovered),
    }
    theory = {
        "modulus (N/m2)": MODULUS,
        "Mindlin 0.1 N (N/m)": smooth[0.1],
        "Mindlin 1 N (N/m)": smooth[1.0],
        "asperities (N/m)": rough,
    }
    drawn = {"eq14": {"preload (N)": shown, "sigma_0 (N/m)": 5e6 * shown + 7e6}}
    return Result(values, tables={"": table, "_theory": theory}, drawn=drawn)


def eigenfrequency() -> Result:
    """How far the actuator's first eigenfrequency lies above the ringing."""
    force, vibration, joint = (
        Plant.of(columns(base)).ringing_frequency for base in (TABLE_1, TABLE_1_VIBRATION, JOINT)
    )
    values = {
        "eigenfrequency over Table 1's vibration, both measured": EIGENFREQUENCY / VIBRATION,
        "eigenfrequency over the simulated ringing": (
            EIGENFREQUENCY / force,
            EIGENFREQUENCY / joint,
        ),
        "the same with sigma_0 from the vibration (Eq. 11)": EIGENFREQUENCY / vibration,
    }
    return Result(values)


class Curves(NamedTuple):
    """Generated force (N) over `PRELOAD`."""

    constant: Array
    linear: Array
    capped: Array

    @property
    def highest(self) -> list[tuple[float, float]]:
        """Preload (N) and force (N) of the maximum of each."""
        return [maximum(PRELOAD, curve) for curve in self]

    @property
    def gain(self) -> float:
        """The largest force with linear over that with constant stiffness."""
        (_, constant), (_, linear), _ = self.highest
        return linear / constant


def stiffness_curves(base: Set, constant: float) -> Curves:
    """Return the three curves of a set with a constant stiffness (N/m)."""
    return Curves(
        forces({**base, "sigma_0": constant}, PRELOAD),
        forces(base, PRELOAD),
        forces({**base, "sigma_0_cap": BOUND}, PRELOAD),
    )


def curves_of_both_sets() -> tuple[Curves, Curves]:
    """Return the curves with Table 1 and with the joint set."""
    return stiffness_curves(TABLE_1, CONSTANT), stiffness_curves(
        {**JOINT, "spring": JOINT_SENSOR}, JOINT_CONSTANT
    )


def _numbers(found: Curves) -> Values:
    (at_constant, force), (at_linear, high), (at_capped, _) = found.highest
    constant, linear, capped = (curve[PRELOAD > BOUND] for curve in found)
    return {
        "maxima, constant": peaks(found.constant),
        "maximum, constant, at": at_constant,
        "maximum, linear, at": at_linear,
        "maximum, linear, right of constant by": at_linear - at_constant,
        "level, linear over constant": found.gain,
        "linear less capped above 2 N, at least": np.min(linear - capped),
        "capped less constant above 2 N, at least": np.min(capped - constant),
        "maximum, capped, at": at_capped,
        "largest force, constant": force,
        "largest force, linear": high,
    }


def bounds_of_force() -> Result:
    """The curves of both sets."""
    sets = dict(zip(("", "_joint"), curves_of_both_sets(), strict=True))
    return Result(
        paired(_numbers, *sets.values()),
        tables={
            ending: {
                "preload (N)": PRELOAD,
                **{f"force {name} (N)": curve for name, curve in found._asdict().items()},
            }
            for ending, found in sets.items()
        },
        drawn={f"tops{ending}": tops(found.highest) for ending, found in sets.items()},
    )


# -- the printed numbers of Table 1, the joint set, and Table 5

#: Mass (kg), inclination (rad) and preload (N) that Table 5 leads back to: Table 4 is missing from
#: our copy.
_GUIDE_MASS, _ALPHA, _GUIDE_PRELOAD = 3e-3, 0.5 * math.pi, 0.2
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
    old, new = curves_of_both_sets()
    (constant, _), (linear, _), _ = new.highest
    (old_constant, _), (old_linear, _), _ = old.highest
    was = _step_and_ringing(TABLE_1)
    values = {
        "step size": step,
        "backstep": share,
        "vibration": ringing,
        "preload at which the straight fall of the steps ends": zero_preload(JOINT),
        "preload at the maximum of Fig. 15, constant sigma_0 (CEIM)": constant,
        "preload at the maximum of Fig. 15, linear sigma_0 (CEIM)": linear,
        "largest force of Fig. 15, linear over constant sigma_0": new.gain,
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
    forces = forces_by_preload(geometry, _GUIDE_MASS, _ALPHA, _GUIDE_PRELOAD)
    ours = 1e3 * np.array(astuple(forces))

    values = {
        **dict(zip("ABCDEF", ours, strict=True)),
        "sum of the normal forces": forces.total,
        "sum over preload": preload_ratio(forces, _GUIDE_PRELOAD),
        "(a - b) / (2 e)": geometry.lever,
    }
    table = {"ours (mN)": ours, "printed (mN)": np.array(_PRINTED)}
    return Result(values, tables={"": table})
