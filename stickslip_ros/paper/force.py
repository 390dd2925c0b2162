# SPDX-License-Identifier: Apache-2.0
"""Fig. 15: generated force against preload for constant, linear and capped stiffness."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from stickslip_ros.paper import style
from stickslip_ros.paper.claim import ALL_OF_THEM, Bounds, Result, extra, number, trend
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
#: With Table 1, N/m: the constant stiffness (p of Eq. 14), which the paper does not give.
CONSTANT = 7e6
#: Preload (N) from which Eq. 14 stays constant.
BOUND = 2.0
#: Of two curves that do not touch, N.
_APART = Bounds(1e-4, 1.0, "more than the error of a curve, less than the force itself")


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

    return Result(
        checks=(
            trend("maxima, constant", float(peaks(ours.constant)), "", "one clear maximum",
                  Bounds(1.0, 1.0, ALL_OF_THEM), joint=float(peaks(joint.constant))),
            number("maximum, constant, at", at_constant, "N", 1.7, joint=joint_constant),
            number("maximum, linear, at", at_linear, "N", 2.8, joint=joint_linear),
            trend("maximum, linear, right of constant by", at_linear - at_constant, "N",
                  "it shifts to the right", Bounds(0.1, 6.0, "seen on the axis of the figure"),
                  joint=joint_linear - joint_constant),
            number("level, linear over constant", ours.gain, "", 2.0, "doubled", joint.gain),
            trend("linear less capped above 2 N, at least", least(ours.linear, ours.capped), "N",
                  "the bound pulls it back", _APART, joint=least(joint.linear, joint.capped)),
            trend("capped less constant above 2 N, at least", least(ours.capped, ours.constant),
                  "N", "still a gain", _APART, joint=least(joint.capped, joint.constant)),
            number("maximum, capped, at", at_capped, "N", 2.0, "around 2 N", joint_capped),
            extra("largest force, constant", force, "N", joint=joint_force),
            extra("largest force, linear", high, "N", joint=joint_high),
        ),
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
