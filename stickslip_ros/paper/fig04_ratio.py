# SPDX-License-Identifier: Apache-2.0
"""Fig. 4: the ratio of z_ba to z_ss, and where steps go backwards."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from stickslip_ros.paper import drawing
from stickslip_ros.paper.drawing import panel, signed_map
from stickslip_ros.paper.item import Check, Item, Kind, Result
from stickslip_ros.paper.operating import EPM_FIX, NANO, columns, mesh, steps, volts
from stickslip_ros.studies.zero_amplitude import zero_amplitudes
from stickslip_ros.traces.steps import MEASURABLE, TRIAL_STEPS

RATIOS = (0.9, 0.5, 0.05)
_Z_SS = 100e-9
DEFLECTION = np.linspace(5e-9, 160e-9, 63)
#: For the maps: steps from rest until what repeats has settled, and the axes.
_SETTLED = 40
FREQUENCY = np.linspace(500.0, 6000.0, 111)
PRELOAD = np.linspace(0.2, 6.0, 59)
_COARSE = np.linspace(10e-9, 160e-9, 40)


def _epm(ratio: float) -> dict[str, object]:
    return {**EPM_FIX, "z_ba": ratio * _Z_SS, "z_ss": _Z_SS}


def ratios() -> Result:
    """Steps over amplitude, and 0-amplitude, for three ratios."""
    curves = {ratio: steps(_epm(ratio), amplitude=volts(DEFLECTION)) for ratio in RATIOS}
    zero = zero_amplitudes(
        columns(EPM_FIX, z_ba=_Z_SS * np.array(RATIOS)), len(RATIOS), TRIAL_STEPS
    )
    smallest = min(float(np.min(curve)) for curve in curves.values())

    def draw(figure: Figure) -> None:
        axes = panel(figure, "amplitude: actuator deflection (nm)", "step size (nm)")
        for (ratio, curve), colour, tag in zip(
            curves.items(), (drawing.LUGRE, drawing.CEIM, drawing.EPM), "abc", strict=True
        ):
            axes.plot(
                NANO * DEFLECTION, NANO * curve, color=colour, label=f"({tag}) {100 * ratio:g} %"
            )
        axes.set(xlim=(0.0, 160.0))
        axes.axhline(0.0, color=drawing.BLACK, linewidth=0.6)
        axes.legend(title="z_ba / z_ss", loc="upper left", fontsize=8.5)

    return Result(
        checks=(
            Check(
                "0-amplitude at 90 % over that at 50 %",
                float(zero[0] / zero[1]),
                paper="larger",
                low=1.05,
            ),
            Check("0-amplitude at 90 %", NANO * float(zero[0]), "nm", kind=Kind.OURS),
            Check("0-amplitude at 50 %", NANO * float(zero[1]), "nm", kind=Kind.OURS),
            Check("0-amplitude at 5 %", NANO * float(zero[2]), "nm", kind=Kind.OURS),
            Check("smallest step of all curves", NANO * smallest, "nm", kind=Kind.OURS),
        ),
        tables={
            "": {
                "deflection (m)": DEFLECTION,
                **{f"step at {100 * r:g} % (m)": curve for r, curve in curves.items()},
            },
            "_zero": {"z_ba / z_ss": np.array(RATIOS), "0-amplitude (m)": zero},
        },
        draw=draw,
    )


def negative_steps() -> Result:
    """Maps of the step size: EPM at 5 % over amplitude and frequency, CEIM over preload."""
    curve = steps(_epm(0.05), amplitude=volts(DEFLECTION))
    frequency, deflection = mesh(FREQUENCY, _COARSE)
    epm = steps(_epm(0.05), _SETTLED, frequency=frequency, amplitude=volts(deflection))
    over, preload = mesh(FREQUENCY, PRELOAD)
    ceim, late = (
        steps({}, _SETTLED, frequency=over, preload=preload, z_ba=ratio * z_ss, z_ss=z_ss)
        for ratio, z_ss in ((0.5, 4e-8 * preload + 2e-8), (0.9, 4e-8 * preload + 2e-8))
    )

    def draw(figure: Figure) -> None:
        for at, (what, y, y_label, values, limit) in enumerate(
            (
                ("EPM, z_ba / z_ss = 5 %", NANO * _COARSE, "amplitude (nm)", epm, 0.4),
                ("CEIM (50 %), 160 nm, 4 g", PRELOAD, "preload (N)", ceim, 40.0),
                ("CEIM, but 90 %, 160 nm, 4 g", PRELOAD, "preload (N)", late, 40.0),
            )
        ):
            axes = panel(figure, "frequency (kHz)", y_label, what, (3, 1, at + 1))
            grid = NANO * values.reshape(len(FREQUENCY), len(y)).T
            signed_map(axes, 1e-3 * FREQUENCY, y, grid, "step size (nm)\nred: backwards", limit)

    return Result(
        checks=(
            Check(
                "smallest step at 5 %, 100 Hz",
                NANO * float(np.min(curve)),
                "nm",
                "negative steps",
                high=-NANO * MEASURABLE,
            ),
            _share("points with negative steps at 5 %, 0.5 to 6 kHz", epm),
            Check(
                "lowest step at 5 %, 0.5 to 6 kHz", NANO * float(np.min(epm)), "nm", kind=Kind.OURS
            ),
            *_lowest("CEIM, 50 %", ceim, over, preload),
            *_lowest("CEIM, 90 %", late, over, preload),
            Check(
                "lowest step of the CEIM at 90 %, 2.4 N, 1.6 to 1.9 kHz",
                NANO * float(np.min(_near_example())),
                "nm",
                kind=Kind.OURS,
            ),
        ),
        tables={
            "_epm": {
                "frequency (Hz)": frequency,
                "deflection (m)": deflection,
                "step at 5 % (m)": epm,
            },
            "_ceim": {
                "frequency (Hz)": over,
                "preload (N)": preload,
                "step CEIM at 50 % (m)": ceim,
                "step CEIM at 90 % (m)": late,
            },
        },
        draw=draw,
        size=(6.2, 8.6),
        remark=(
            "The paper calls these steps a side effect of the simulation. With a converged "
            "integration none occur at 100 Hz, at any ratio. They are real where cycles are so "
            "fast that the ringing of one slip meets the next in the wrong phase: along bands "
            "in the maps, where a whole number of swings fits into the cycle, and the more the "
            "larger the ratio is, not the smaller."
        ),
    )


def _share(what: str, values: NDArray[np.float64]) -> Check:
    return Check(what, 100.0 * float(np.mean(values < -MEASURABLE)), "%", kind=Kind.OURS)


def _lowest(
    what: str,
    values: NDArray[np.float64],
    frequency: NDArray[np.float64],
    preload: NDArray[np.float64],
) -> tuple[Check, ...]:
    k = int(np.argmin(values))
    where = f"at {preload[k]:.2g} N and {1e-3 * frequency[k]:.2g} kHz"
    return (
        _share(f"points with negative steps, {what}", values),
        Check(f"lowest step, {what}, {where}", NANO * float(values[k]), "nm", kind=Kind.OURS),
    )


def _near_example() -> NDArray[np.float64]:
    z_ss = 4e-8 * 2.4 + 2e-8
    base = {"preload": 2.4, "z_ba": 0.9 * z_ss, "z_ss": z_ss}
    return steps(base, _SETTLED, frequency=np.linspace(1600.0, 1900.0, 31))


RATIO = Item(
    name="fig04",
    title="A larger z_ba / z_ss enlarges the 0-amplitude",
    place="Fig. 4a and b, section 3",
    statement=(
        "With z_ba at 50 % of z_ss the elastoplastic law comes close to the measured curve; at "
        "90 % the 0-amplitude is larger."
    ),
    setup="EPM with fixed z_ss = 100 nm, other parameters of Table 2; 100 Hz, 100 V/us.",
    compute=ratios,
)
NEGATIVE = Item(
    name="fig04c",
    title="Negative steps: not at 5 %, but near the ringing",
    place="Fig. 4c, section 3",
    statement=(
        "At a ratio of 5 % the simulation tends to steps against the direction of the drive, "
        "which the paper takes for a side effect of simulating."
    ),
    setup=(
        "100 Hz for the judged number; the maps show step sizes after 40 cycles over frequency. "
        "EPM: z_ss = 100 nm, Table 2. CEIM: Table 1."
    ),
    compute=negative_steps,
)
