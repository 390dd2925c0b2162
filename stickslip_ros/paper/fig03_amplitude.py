# SPDX-License-Identifier: Apache-2.0
"""Fig. 3: step size against amplitude: ideal, LuGre, and laws with a dead zone."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from stickslip_ros.paper import drawing
from stickslip_ros.paper.drawing import legend, panel
from stickslip_ros.paper.item import Check, Item, Result
from stickslip_ros.paper.operating import EPM_FIX, LUGRE, NANO, NO_STEP, steps, volts

#: Amplitudes as actuator deflection, m; LuGre is convex over the lower part.
DEFLECTION = np.linspace(5e-9, 160e-9, 63)
_SMALL = DEFLECTION <= 80e-9
#: Up to this part of z_ba there has to be no step at all.
_SURELY_DEAD = 0.9


def compute() -> Result:
    """Steps over amplitude for LuGre, EPM with fixed z_ss, and CEIM."""
    amplitude = volts(DEFLECTION)
    lugre = steps(LUGRE, amplitude=amplitude)
    epm = steps(EPM_FIX, amplitude=amplitude)
    ceim = steps({"preload": 1.0}, amplitude=amplitude)
    dead_epm = DEFLECTION <= _SURELY_DEAD * 50e-9
    dead_ceim = DEFLECTION <= _SURELY_DEAD * 30e-9

    def draw(figure: Figure) -> None:
        axes = panel(figure, "amplitude: actuator deflection (nm)", "step size (nm)")
        x = NANO * DEFLECTION
        axes.plot(x, x, "--", color=drawing.GREY, label="ideal: step = amplitude")
        axes.plot(x, NANO * ceim, color=drawing.CEIM, label="CEIM, 1 N")
        axes.plot(x, NANO * lugre, color=drawing.LUGRE, label="LuGre, Table 2, 0.4 N")
        axes.plot(x, NANO * epm, color=drawing.EPM, label="EPM, z_ss fixed, Table 2")
        axes.axvspan(0.0, 30.0, color=drawing.CEIM, alpha=0.07, linewidth=0)
        axes.annotate("z_ba of the CEIM: 30 nm", (31.0, 148.0), fontsize=8, color=drawing.CEIM)
        axes.set(xlim=(0.0, 160.0), ylim=(-4.0, 160.0))
        legend(axes, "center left")

    return Result(
        checks=(
            Check(
                "smallest LuGre step, at 5 nm",
                NANO * float(lugre[0]),
                "nm",
                "small amplitudes still step",
                low=0.01,
            ),
            Check(
                "amplitudes at which LuGre does not step",
                float(np.sum(lugre <= 0.0)),
                paper="none",
                high=0.0,
            ),
            Check(
                "smallest second difference of LuGre up to 80 nm",
                NANO * float(np.min(np.diff(lugre[_SMALL], 2))),
                "nm",
                "a quadratic curve",
                low=0.0,
            ),
            Check(
                "largest EPM step up to 45 nm",
                NANO * float(np.max(np.abs(epm[dead_epm]))),
                "nm",
                "a dead zone, as measured",
                high=NANO * NO_STEP,
            ),
            Check(
                "largest CEIM step up to 27 nm",
                NANO * float(np.max(np.abs(ceim[dead_ceim]))),
                "nm",
                "a dead zone, as measured",
                high=NANO * NO_STEP,
            ),
            Check(
                "largest step over the ideal one",
                float(np.max(np.stack([lugre, epm, ceim]) / DEFLECTION)),
                paper="the ideal line lies above",
                high=1.0,
            ),
        ),
        tables={
            "": {
                "deflection (m)": DEFLECTION,
                "step LuGre (m)": lugre,
                "step EPM_fix (m)": epm,
                "step CEIM 1 N (m)": ceim,
            }
        },
        draw=draw,
        remark="The figure has no numbers in the text, so only its trends can be compared.",
    )


ITEM = Item(
    name="fig03",
    title="Step size against amplitude: the dead zone",
    place="Fig. 3, section 2.1",
    statement=(
        "Ideally the step grows in proportion to the amplitude. LuGre gives a quadratic curve that "
        "steps however small the amplitude is; the measured drive has a dead zone, up to the "
        "0-amplitude, in which it does not step at all."
    ),
    setup=(
        "100 Hz, 100 V/us. LuGre and EPM with the parameters of Table 2 at 0.4 N, CEIM at 1 N "
        "with 4 g. The measured curve is not in the text."
    ),
    compute=compute,
)
