# SPDX-License-Identifier: Apache-2.0
"""Fig. 15: generated force against preload for constant, linear and capped stiffness."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from stickslip_ros.paper import style
from stickslip_ros.paper.claim import Result
from stickslip_ros.paper.materials import maximum, peaks
from stickslip_ros.paper.parameter_sets import (
    JOINT,
    JOINT_CONSTANT,
    JOINT_SENSOR,
    TABLE_1,
    Array,
    Set,
    forces,
)
from stickslip_ros.paper.style import legend, panel

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


def curves(base: Set, constant: float) -> Curves:
    """Return the three curves of a set with a constant stiffness (N/m)."""
    return Curves(
        forces({**base, "sigma_0": constant}, PRELOAD),
        forces(base, PRELOAD),
        forces({**base, "sigma_0_cap": BOUND}, PRELOAD),
    )


def both() -> tuple[Curves, Curves]:
    """Return the curves with Table 1 and with the joint set."""
    return curves(TABLE_1, CONSTANT), curves({**JOINT, "spring": JOINT_SENSOR}, JOINT_CONSTANT)


def generated_force() -> Result:
    """The curves of both sets."""
    ours, joint = both()
    above = PRELOAD > BOUND
    (at_constant, force), (at_linear, high), (at_capped, _) = ours.highest
    (joint_constant, joint_force), (joint_linear, joint_high), (joint_capped, _) = joint.highest

    def least(upper: Array, lower: Array) -> float:
        return float(np.min((upper - lower)[above]))

    def draw(figure: Figure) -> None:
        for at, (found, title) in enumerate(((ours, "Table 1"), (joint, "joint set"))):
            _draw(figure, at + 1, found, title)

    values = {
        "maxima, constant": (peaks(ours.constant), peaks(joint.constant)),
        "maximum, constant, at": (at_constant, joint_constant),
        "maximum, linear, at": (at_linear, joint_linear),
        "maximum, linear, right of constant by": (
            at_linear - at_constant,
            joint_linear - joint_constant,
        ),
        "level, linear over constant": (ours.gain, joint.gain),
        "linear less capped above 2 N, at least": (
            least(ours.linear, ours.capped),
            least(joint.linear, joint.capped),
        ),
        "capped less constant above 2 N, at least": (
            least(ours.capped, ours.constant),
            least(joint.capped, joint.constant),
        ),
        "maximum, capped, at": (at_capped, joint_capped),
        "largest force, constant": (force, joint_force),
        "largest force, linear": (high, joint_high),
    }
    return Result(
        values,
        tables={
            ending: {"preload (N)": PRELOAD,
                     **{f"force {name} (N)": curve for name, curve in found._asdict().items()}}
            for ending, found in (("", ours), ("_joint", joint))
        },
        draw=draw,
        size=(6.2, 7.4),
    )  # fmt: skip


def _draw(figure: Figure, row: int, found: Curves, title: str) -> None:
    axes = panel(figure, "preload (N)", "generated force (N)", title, (2, 1, row))
    names = ("constant", "linear (Eq. 14)", "linear with upper bound (2 N)")
    colours = (style.EPM, style.CEIM, style.LUGRE)
    for curve, top, form, colour, name in zip(
        found, found.highest, ("-", "-", "--"), colours, names, strict=True
    ):
        axes.plot(PRELOAD, curve, form, color=colour, label=name)
        axes.plot(*top, "o", color=colour, markersize=5)
    for preload, colour in ((1.7, style.EPM), (2.8, style.CEIM)):
        axes.axvline(preload, color=colour, linewidth=0.9, linestyle=":")
        axes.annotate(f"paper\n{preload:g} N", (preload + 0.06, 0.01), fontsize=8, color=colour)
    axes.set(xlim=(0.0, 6.0), ylim=(0.0, 1.35 * max(force for _, force in found.highest)))
    legend(axes, "upper right")
