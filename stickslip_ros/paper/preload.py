# SPDX-License-Identifier: Apache-2.0
"""Fig. 5 and 14, Table 2, sections 3 and 4.3: what the preload does to the step."""

from __future__ import annotations

import math

import numpy as np

from stickslip_ros.library.operating_points import blocking_preloads
from stickslip_ros.model import Plant
from stickslip_ros.paper import style
from stickslip_ros.paper.claim import VANISHES, Bounds, Result, Verdict, extra, number, trend
from stickslip_ros.paper.parameter_sets import (
    EPM_CALC,
    EPM_FIX,
    FULL_DEFLECTION,
    JOINT,
    LUGRE,
    TABLE_1,
    Array,
    Set,
    columns,
    one_step,
    steps,
)
from stickslip_ros.paper.style import NANO, lines
from stickslip_ros.traces.steps import MEASURABLE, TRIAL_STEPS

PRELOAD = np.linspace(0.25, 10.0, 79)
#: Where the straight fall of Fig. 14 is looked at, N.
_MIDDLE = (0.5, 3.5)
#: A carried runner: a vertical axis with the heaviest runner of Table 1; few steps, for it falls.
CARRIED: Set = {"inclination": 0.5 * math.pi, "mass": 15e-3}
#: What such a runner falls in the last of three cycles of 10 ms at most, m.
_FREE_FALL = -0.5 * 9.81 * (0.03**2 - 0.02**2)
LOW_PRELOAD, _FEW = np.array([0.1, 0.15, 0.2, 0.3, 0.4, 0.6, 1.0, 1.5, 2.0, 3.0, 4.0]), 3


def earlier_laws() -> Result:
    """Steps over preload for the three attempts of Fig. 5."""
    lugre, fix, calc = (steps(base, preload=PRELOAD) for base in (LUGRE, EPM_FIX, EPM_CALC))
    symmetric = steps({**EPM_CALC, "alpha_form": "dupont"}, preload=PRELOAD)
    above = 1.0 + PRELOAD[1] - PRELOAD[0] < PRELOAD  # the next point after the crossing
    near = np.linspace(0.9, 1.2, 31)
    turn = near[int(np.argmax(steps(EPM_CALC, preload=near) < 0.0))]
    low, high = int(np.searchsorted(PRELOAD, 0.5)), -1
    return Result(
        checks=(
            *(trend(f"smallest {law} step up to 10 N", np.min(step), "m", "never reaches zero",
                    Bounds(MEASURABLE, FULL_DEFLECTION, "measurable, at most the stroke"))
              for law, step in (("LuGre", lugre), ("EPM_fix", fix))),
            *(trend(f"{law} step at 0.5 N over that at 10 N", step[low] / step[high], "",
                    "falls" if law == "LuGre" else "similar to LuGre",
                    Bounds(1.5, 22.0, "plainly; at most in inverse proportion, a tenth more"))
              for law, step in (("LuGre", lugre), ("EPM_fix", fix))),
            trend("correlation of EPM_fix with LuGre over preload",
                  np.corrcoef(lugre, fix)[0, 1], "", "similar courses",
                  Bounds(0.95, 1.0, "as curves of one kind")),
            trend("largest EPM_calc step from 1.2 N on", np.max(calc[above]), "m", "negative",
                  Bounds(-FULL_DEFLECTION, 0.0, "below zero throughout")),
            trend("EPM_calc at 10 N over its lowest step", calc[high] / np.nanmin(calc), "",
                  "approaches zero", VANISHES),
            number("preload from which EPM_calc is negative", turn, "N", 1.0),
            extra("smallest EPM_calc step, alpha with |z|", np.nanmin(symmetric), "m"),
        ),
        tables={
            "": {
                "preload (N)": PRELOAD,
                "step LuGre (m)": lugre,
                "step EPM_fix (m)": fix,
                "step EPM_calc, alpha as printed (m)": calc,
                "step EPM_calc, alpha with |z| (m)": symmetric,
            }
        },
        draw=lines(
            PRELOAD,
            (
                (NANO * lugre, "LuGre", style.LUGRE, "-"),
                (NANO * fix, "EPM, z_ss fixed", style.EPM, "-"),
                (NANO * calc, "EPM, z_ss calculated (above 0.5 N)", style.EPM_CALC, "-"),
                (NANO * symmetric, "the same, alpha with |z|", style.EPM_CALC, ":"),
            ),
            ("preload (N)", "step size (nm)"),
            "upper right",
            zero=True,
            xlim=(0.0, 10.0),
        ),
        remark=(
            "EPM_fix keeps g(v) below the fraction of Eq. 7; the fixed z_ss stands in alpha alone. "
            "EPM_calc is computed with alpha as printed, where the sine has z instead of |z|: only "
            "so its steps turn negative above 1 N, as the figure says. With |z| it approaches zero "
            "from above (dotted). With Table 2 it is defined above 0.5 N, where z_ss stays above "
            "z_ba = 100 nm."
        ),
    )  # fmt: skip


def _straight_part(step: Array) -> tuple[float, float]:
    """Return where a straight line through `_MIDDLE` crosses zero (N), and its R2."""
    middle = (_MIDDLE[0] <= PRELOAD) & (_MIDDLE[1] >= PRELOAD)
    slope, level = np.polyfit(PRELOAD[middle], step[middle], 1)
    left = step[middle] - np.polyval((slope, level), PRELOAD[middle])
    return -level / slope, 1.0 - float(np.var(left) / np.var(step[middle]))


def zero_preload(base: Set) -> float:
    """Return the preload (N) at which the straight fall of the steps reaches zero."""
    return _straight_part(steps(base, preload=PRELOAD))[0]


def ceim() -> Result:
    """Steps over preload for the CEIM, and a straight line through the middle, for both sets."""
    table_1, joint = (steps(base, preload=PRELOAD) for base in (TABLE_1, JOINT))
    (crossing, r2), (joint_crossing, joint_r2) = map(_straight_part, (table_1, joint))
    at_most_1, late = PRELOAD <= 1.0, PRELOAD >= 7.0
    blocking, joint_blocking = (
        float(blocking_preloads(columns(base), 1, TRIAL_STEPS)[0]) for base in (TABLE_1, JOINT)
    )
    shown = (0.0, joint_crossing)
    straight = np.interp(PRELOAD, shown, [joint[0] + joint[0] / (joint_crossing / 0.25 - 1.0), 0.0])
    return Result(
        checks=(
            trend("smallest step up to 1 N", np.min(table_1[at_most_1]), "m", "above 100 nm",
                  Bounds(100e-9, FULL_DEFLECTION, "as the paper has it; at most the stroke"),
                  joint=np.min(joint[at_most_1])),
            trend("R2 of a line through 0.5 to 3.5 N", r2, "", "falls linearly",
                  Bounds(0.98, 1.0, "a fiftieth of the variance is left at most"), joint=joint_r2),
            number("preload at which this line reaches zero", crossing, "N", 5.0,
                   "about 5 N", joint_crossing),
            trend("step at 5.5 N", np.interp(5.5, PRELOAD, table_1), "m", "zero from near 5 N on",
                  Bounds(-1e-9, 1e-9, "what a bench resolves, a tenth above 5 N"),
                  joint=np.interp(5.5, PRELOAD, joint)),
            number("preload that blocks the drive", blocking, "N", 5.0, "about 5 N",
                   joint_blocking),
            trend("largest step at 7 N and above", np.max(np.abs(table_1[late])), "m",
                  "remains zero", Bounds(0.0, 1e-9, "what a bench resolves"),
                  joint=np.max(np.abs(joint[late]))),
        ),
        tables={
            "": {
                "preload (N)": PRELOAD,
                "step CEIM (m)": table_1,
                "step CEIM, joint set (m)": joint,
            }
        },
        draw=lines(
            PRELOAD,
            (
                (NANO * table_1, "CEIM, Table 1", style.CEIM, "-"),
                (NANO * joint, "CEIM, joint set", style.LUGRE, "-"),
                (NANO * straight, "straight, to zero", style.GREY, "--"),
            ),
            ("preload (N)", "step size (nm)"),
            "upper right",
            xlim=(0.0, 8.0),
            ylim=(-6.0, 165.0),
        ),
    )  # fmt: skip


def parameter_sets() -> Result:
    """Table 2: the sets as they are built, and the range of a calculated z_ss."""
    contact = {
        name: Plant.of(columns({**base, "preload": 1.0})).contact
        for name, base in (("LuGre", LUGRE), ("EPM_calc", EPM_CALC), ("EPM_fix", EPM_FIX))
    }
    rest = np.array([0.6, 1.0, 1.5, 2.0, 5.0, 10.0])
    sets = [columns({**EPM_CALC, "preload": float(f)}) for f in rest]
    z_ss = np.array([Plant.of(one).contact.z_s for one in sets])
    return Result(
        checks=(
            *(extra(f"sigma_0, {n}", c.sigma_0, "N/m", "1 N/µm") for n, c in contact.items()),
            *(extra(f"sigma_1, {n}", c.sigma_1, "N s/m", "5") for n, c in contact.items()),
            extra("mu_s of LuGre", contact["LuGre"].z_s * 1e6, "", "0.3"),
            extra("mu_k of LuGre", contact["LuGre"].z_k * 1e6, "", "0.2"),
            extra("z_ba, EPM_calc", contact["EPM_calc"].z_ba, "m", "100 nm"),
            extra("z_ba, EPM_fix", contact["EPM_fix"].z_ba, "m", "50 nm"),
            extra("z_ss, EPM_fix", contact["EPM_fix"].z_ss, "m", "100 nm"),
            extra("z_ss of EPM_calc at 1.5 N, at rest", z_ss[2], "m", "450 nm"),
            extra("z_ss of EPM_calc at 2 N, at rest", z_ss[3], "m", "600 nm"),
            extra("z_ss of EPM_calc at 0.6 N", z_ss[0], "m"),
            extra("z_ss of EPM_calc at 10 N", z_ss[-1], "m"),
        ),
        tables={"": {"preload (N)": rest, "z_ss of EPM_calc at rest (m)": z_ss}},
        settled=Verdict.DATA,
    )


def too_low() -> Result:
    """Steps of a runner that the axis carries, from too low a preload on."""
    ceim = steps(CARRIED, _FEW, preload=LOW_PRELOAD)
    light = one_step({"inclination": 0.5 * math.pi, "preload": 0.01})
    what = "motion in a cycle"
    return Result(
        checks=(
            trend(f"{what} at 0.1 N", ceim[0], "m", "the runner is not transported",
                  Bounds(_FREE_FALL, -1e-6, "sinks by many strokes, at most as in free fall")),
            trend(f"{what} at 1 N", ceim[6], "m", "in between there are steps",
                  Bounds(10e-9, FULL_DEFLECTION, "seen by eye in a record; at most the stroke")),
            trend(f"{what} at 4 N, over that at 1 N", ceim[-1] / ceim[6], "",
                  "a high preload makes slip impossible",
                  Bounds(-0.1, 0.1, "neither steps nor sinks by more than a tenth of a step")),
            extra(f"{what} at 0.01 N with the 4 g of Table 1", light, "m"),
            extra("friction that Eq. 13 times Eq. 14 leaves without any preload", 1e-8 * 7e6, "N"),
        ),
        tables={"": {"preload (N)": LOW_PRELOAD, f"{what} (m)": ceim}},
        draw=lines(
            LOW_PRELOAD,
            ((NANO * ceim, "CEIM", style.CEIM, "o-"),),
            ("preload (N)", f"{what} (nm), up is positive"),
            zero=True,
            xscale="log",
            ylim=(-160.0, 160.0),
        ),
    )  # fmt: skip
