# SPDX-License-Identifier: Apache-2.0
"""Fig. 6, 8, 9, 12 and Table 3: what the paper measured on runners of different materials.

Material enters no equation of the paper and the text gives no values of these measurements. What
can be shown is the model's counterpart: what happens if the constants change in the direction that
the paper supposes of a stiffer material. These curves are ours.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.signal import find_peaks

from stickslip_ros.model.materials import MATERIALS
from stickslip_ros.paper import drawing
from stickslip_ros.paper.drawing import legend, panel
from stickslip_ros.paper.item import Check, Item, Kind, Result
from stickslip_ros.paper.operating import NANO, columns
from stickslip_ros.studies.blocking_preload import blocking_preloads
from stickslip_ros.studies.generated_force import generated_forces
from stickslip_ros.studies.operating_points import steps_of
from stickslip_ros.studies.zero_amplitude import zero_amplitudes
from stickslip_ros.traces.steps import TRIAL_STEPS

#: z_ba relative to Eq. 13; a stiffer material counts as one with a smaller z_ba.
SCALE = np.linspace(0.5, 1.5, 9)
#: Constant stiffness, N/m: what the paper lets stand for the material in Fig. 12.
STIFFNESS = (3.5e6, 7e6, 14e6)
#: z_ba in parts of Eq. 13 that goes with each, softest material first; ours.
_WITH_Z_BA = (1.3, 1.0, 0.7)
_PRELOAD = np.linspace(0.2, 6.0, 59)
#: A maximum stands out from its surroundings by this part of the largest value.
PROMINENCE = 0.03
_NO_MATERIAL = (
    "Cannot be told: the text has no values of this measurement, and no equation of the paper "
    "holds a material constant. "
)


def _scaled(preload: float) -> dict[str, NDArray[np.float64] | float]:
    return {"z_ba_slope": 2e-8 * SCALE, "z_ba_offset": 1e-8 * SCALE, "preload": preload}


def peaks(values: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the indices of maxima that stand out by `PROMINENCE` of the largest value."""
    padded = np.concatenate(([0.0], values, [0.0]))  # so that an end can be a maximum too
    found, _ = find_peaks(padded, prominence=PROMINENCE * float(np.max(values)))
    return found - 1  # type: ignore[no-any-return]


def zero_amplitude() -> Result:
    """0-amplitude over the breakaway distance."""
    zero = zero_amplitudes(columns({}, **_scaled(1.0)), len(SCALE), TRIAL_STEPS)
    return Result(
        checks=(
            Check("0-amplitude with z_ba at 50 %", NANO * float(zero[0]), "nm", kind=Kind.OURS),
            Check("0-amplitude with z_ba at 100 %", NANO * float(zero[4]), "nm", kind=Kind.OURS),
            Check("0-amplitude with z_ba at 150 %", NANO * float(zero[-1]), "nm", kind=Kind.OURS),
        ),
        tables={"": {"z_ba / Eq. 13": SCALE, "0-amplitude (m)": zero}},
        draw=_draw_scaled(NANO * zero, "0-amplitude (nm)"),
        remark=_NO_MATERIAL
        + "The curve is the model's counterpart, marked as ours: the 0-amplitude follows z_ba, "
        "so a material that halves the one halves the other.",
    )


def blocking() -> Result:
    """Blocking preload over the breakaway distance."""
    found = blocking_preloads(columns({}, **_scaled(1.0)), len(SCALE), TRIAL_STEPS)
    return Result(
        checks=(
            Check("blocking preload with z_ba at 50 %", float(found[0]), "N", kind=Kind.OURS),
            Check("blocking preload with z_ba at 100 %", float(found[4]), "N", kind=Kind.OURS),
            Check("blocking preload with z_ba at 150 %", float(found[-1]), "N", kind=Kind.OURS),
        ),
        tables={"": {"z_ba / Eq. 13": SCALE, "blocking preload (N)": found}},
        draw=_draw_scaled(found, "blocking preload (N)"),
        remark=_NO_MATERIAL
        + "The curve is the model's counterpart, marked as ours: a smaller z_ba blocks later, "
        "which goes with Fig. 6 and 9 if a stiffer runner is one with a smaller z_ba.",
    )


def step_shapes() -> Result:
    """Backstep and step over the breakaway distance."""
    step, backstep = steps_of(columns({}, **_scaled(1.0)), len(SCALE), TRIAL_STEPS)

    def draw(figure: Figure) -> None:
        axes = panel(figure, "z_ba, in parts of Eq. 13", "length (nm)", "ours: CEIM, 1 N")
        axes.plot(SCALE, NANO * step, color=drawing.CEIM, label="step size")
        axes.plot(SCALE, NANO * backstep, color=drawing.LUGRE, label="backstep")
        axes.set_ylim(0.0, 160.0)
        legend(axes, "upper right")

    return Result(
        checks=(
            Check("backstep with z_ba at 50 %", NANO * float(backstep[0]), "nm", kind=Kind.OURS),
            Check("backstep with z_ba at 150 %", NANO * float(backstep[-1]), "nm", kind=Kind.OURS),
            Check("step with z_ba at 50 %", NANO * float(step[0]), "nm", kind=Kind.OURS),
            Check("step with z_ba at 150 %", NANO * float(step[-1]), "nm", kind=Kind.OURS),
        ),
        tables={"": {"z_ba / Eq. 13": SCALE, "step size (m)": step, "backstep (m)": backstep}},
        draw=draw,
        remark=_NO_MATERIAL
        + "The model's counterpart, marked as ours: a smaller z_ba does shrink the backstep. It "
        "also lengthens the step, where the paper finds it hardly changed for tungsten and "
        "suspects a hidden 0-amplitude.",
    )


def table() -> Result:
    """Table 3: data that nothing is computed from."""
    return Result(
        checks=(),
        tables={"": {"Young's modulus (N/m2)": np.array([m.youngs_modulus for m in MATERIALS])}},
        remark=_NO_MATERIAL
        + ", ".join(f"{m.name} {m.printed_modulus:g}" for m in MATERIALS)
        + " kN/mm2. The trends of Fig. 6 and 9 are given without numbers, so no rule from modulus "
        "to z_ba is built on them.",
    )


def forces() -> Result:
    """Generated force over preload for three constant stiffnesses."""
    curves = [_force(sigma_0=k) for k in STIFFNESS]
    with_z_ba = [
        _force(sigma_0=k, z_ba_slope=2e-8 * scale, z_ba_offset=1e-8 * scale)
        for k, scale in zip(STIFFNESS, _WITH_Z_BA, strict=True)
    ]
    highest = [float(np.max(curve)) for curve in curves]
    where = [float(_PRELOAD[np.argmax(curve)]) for curve in curves]

    def draw(figure: Figure) -> None:
        axes = panel(figure, "preload (N)", "generated force (N)", "ours: constant sigma_0")
        for k, curve, other, scale, colour in zip(
            STIFFNESS, curves, with_z_ba, _WITH_Z_BA, drawing.ORDERED[1:], strict=True
        ):
            label = f"{1e-6 * k:g} N/um"
            axes.plot(_PRELOAD, curve, color=colour, label=label)
            if scale != 1.0:
                label += f", z_ba x {scale:g}"
                axes.plot(_PRELOAD, other, "--", color=colour, label=label)
        axes.set(xlim=(0.0, 6.0), ylim=(0.0, 1.2 * max(map(np.max, with_z_ba))))
        axes.legend(title="sigma_0", fontsize=8.5, loc="upper right")

    return Result(
        checks=(
            *(
                Check(
                    f"maxima at {1e-6 * k:g} N/um",
                    float(len(peaks(curve))),
                    "",
                    "one clear maximum",
                    1.0,
                    1.0,
                )
                for k, curve in zip(STIFFNESS, curves, strict=True)
            ),
            Check(
                "least gain in force by doubling sigma_0",
                min(highest[1] / highest[0], highest[2] / highest[1]),
                paper="stiffer: larger forces",
                low=1.05,
            ),
            Check(
                "least shift of the maximum by doubling sigma_0",
                min(where[1] - where[0], where[2] - where[1]),
                "N",
                "stiffer: at larger preload",
                low=0.05,
            ),
            Check(
                "the same, with z_ba smaller in turn (1.3, 1, 0.7)",
                float(np.min(np.diff([_PRELOAD[np.argmax(curve)] for curve in with_z_ba]))),
                "N",
                "stiffer: at larger preload",
                kind=Kind.OURS,
            ),
            Check("largest force at 7 N/um", highest[1], "N", kind=Kind.OURS),
        ),
        tables={
            "": {
                "preload (N)": _PRELOAD,
                **{
                    f"force at sigma_0 = {k:g} N/m (N)": curve
                    for k, curve in zip(STIFFNESS, curves, strict=True)
                },
                **{
                    f"force at sigma_0 = {k:g} N/m, z_ba x {scale:g} (N)": curve
                    for k, scale, curve in zip(STIFFNESS, _WITH_Z_BA, with_z_ba, strict=True)
                },
            }
        },
        draw=draw,
        remark=(
            "The forces are measured on materials; the paper says that the model can represent a "
            "material in force generation by sigma_0 alone, and that is what is judged. sigma_0 "
            "raises the force but does not move its maximum to larger preloads. A smaller z_ba, "
            "which Fig. 6 suggests for stiffer materials, does (dashed; ours)."
        ),
    )


def _force(**changes: float) -> NDArray[np.float64]:
    return generated_forces(columns(changes, preload=_PRELOAD), len(_PRELOAD), 1)


def _draw_scaled(values: NDArray[np.float64], label: str) -> Callable[[Figure], None]:
    def draw(figure: Figure) -> None:
        axes = panel(figure, "z_ba, in parts of Eq. 13", label, "ours: CEIM, 160 nm, 4 g")
        axes.plot(SCALE, values, "o-", color=drawing.CEIM, markersize=4)
        axes.set_ylim(0.0, 1.1 * float(np.max(values)))

    return draw


_SETUP = "CEIM, Table 1 at 1 N, z_ba of Eq. 13 scaled from 0.5 to 1.5 (ours)."
FIGURE_6 = Item(
    name="fig06",
    title="0-amplitude of different runner materials",
    place="Fig. 6, section 4.1.2",
    statement=(
        "Runners of a material with a higher Young's modulus tend to have a smaller 0-amplitude; "
        "the choice can halve it."
    ),
    setup=_SETUP,
    compute=zero_amplitude,
)
FIGURE_8 = Item(
    name="fig08",
    title="Steps of tungsten and aluminium",
    place="Fig. 8, section 4.2",
    statement=(
        "At 1 N a tungsten runner shows a small backstep and almost no vibration, aluminium shows "
        "both; the step size of tungsten is nevertheless like that of others."
    ),
    setup=_SETUP,
    compute=step_shapes,
)
FIGURE_9 = Item(
    name="fig09",
    title="Blocking preload of different runner materials",
    place="Fig. 9, section 4.3",
    statement="Runners of stiffer materials still step at higher preloads, about in proportion.",
    setup=_SETUP + " The preload is what is searched for.",
    compute=blocking,
)
FIGURE_12 = Item(
    name="fig12",
    title="Generated force of different runner materials",
    place="Fig. 12, section 4.6",
    statement=(
        "For every material the generated force rises with the preload to a clear maximum and "
        "falls; stiffer materials reach larger forces, at larger preloads."
    ),
    setup=(
        "CEIM with constant sigma_0 of 3.5, 7 and 14 N/um, else Table 1, against a spring of "
        "1e6 N/m."
    ),
    compute=forces,
)
TABLE_3 = Item(
    name="tab03",
    title="Runner materials",
    place="Table 3",
    statement="Nine runner materials with Young's moduli from 70 to 600 kN/mm2.",
    setup="Nothing is simulated.",
    compute=table,
)
