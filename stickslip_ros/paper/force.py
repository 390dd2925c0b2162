# SPDX-License-Identifier: Apache-2.0
"""Fig. 15: generated force against preload for constant, linear and capped stiffness."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from stickslip_ros.paper.claim import Result, Values, paired
from stickslip_ros.paper.materials import maximum, peaks, tops
from stickslip_ros.paper.parameter_sets import (
    JOINT,
    JOINT_CONSTANT,
    JOINT_SENSOR,
    TABLE_1,
    Array,
    Set,
    forces,
)

PRELOAD = np.linspace(0.2, 6.0, 117)
#: Constant stiffness with Table 1, N/m: p of Eq. 14, for the paper gives none.
CONSTANT = 7e6
#: Preload (N) from which Eq. 14 stays constant.
BOUND = 2.0


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


def both() -> tuple[Curves, Curves]:
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
    sets = dict(zip(("", "_joint"), both(), strict=True))
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
