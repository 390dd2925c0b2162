# SPDX-License-Identifier: Apache-2.0
"""Section 4.2: input shaping, a slip in two parts that leaves no vibration."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from stickslip_ros.model import drive_of
from stickslip_ros.paper import drawing
from stickslip_ros.paper.drawing import legend, panel
from stickslip_ros.paper.item import Check, Item, Kind, Result
from stickslip_ros.paper.operating import NANO
from stickslip_ros.parameters import Parameters
from stickslip_ros.studies.slip_shaping import ShapedSlip, shape_slip, shaping_map
from stickslip_ros.traces.trace import Trace, trace_steps

_PRELOADS = (0.4, 1.0)
_SPLITS, _LATENCIES = np.linspace(0.5, 1.0, 21), np.linspace(0.0, 1.0, 21)
#: What the map can tell apart, m.
_FINEST = 1e-10
#: Of the picture, s after the slip begins.
_SHOWN = (-5e-5, 7e-4)


def compute() -> Result:
    """The best split and latency at two preloads, maps around them, a slip with and without."""
    checks, tables, found = [], {}, {}
    for preload in _PRELOADS:
        p = Parameters.of({"preload": preload})
        best = shape_slip(p)
        latencies = _LATENCIES * best.ringing_period
        ringing = shaping_map(p, _SPLITS, latencies)
        found[preload] = best, ringing
        checks += _checks(preload, best)
        tables[f"_{preload:g}N"] = {
            "split": np.repeat(_SPLITS, len(_LATENCIES)),
            "latency (s)": np.tile(latencies, len(_SPLITS)),
            "ringing (m)": ringing.ravel(),
        }
    p = Parameters.of({"preload": _PRELOADS[0]})
    best = found[_PRELOADS[0]][0]
    shaped = p.replace(waveform="shaped", split=best.split, latency=best.latency)
    single = _after_slip(p)
    double = _after_slip(shaped)

    def draw(figure: Figure) -> None:
        axes = panel(
            figure, "time after the slip begins (us)", "runner (nm)", "0.4 N, first slip", (3, 1, 1)
        )
        for (t, x), colour, label in (
            (single, drawing.LUGRE, "single slip"),
            (double, drawing.CEIM, "slip in two parts"),
        ):
            axes.plot(1e6 * t, NANO * x, color=colour, label=label)
        axes.set_xlim(1e6 * _SHOWN[0], 1e6 * _SHOWN[1])
        axes.set_ylim(1.3 * NANO * float(np.min(single[1])), 5.0)
        legend(axes, "lower right")
        for at, (preload, (one, ringing)) in enumerate(found.items()):
            axes = panel(
                figure,
                "latency (ringing periods)",
                "first part (% of the slip)",
                f"ringing left, {preload:g} N",
                (3, 1, at + 2),
            )
            axes.grid(False)
            image = axes.pcolormesh(
                _LATENCIES,
                100.0 * _SPLITS,
                NANO * np.maximum(np.ma.masked_invalid(ringing), _FINEST),
                shading="nearest",
                cmap="viridis_r",
                norm=LogNorm(),
            )
            axes.plot(
                [one.latency / one.ringing_period],
                [100.0 * one.split],
                "o",
                color="#d3321d",
                markeredgecolor="white",
            )
            bar = figure.colorbar(image, ax=axes, ticks=[5, 10, 20, 50, 100], format="%g")
            bar.minorticks_off()
            bar.set_label("peak to peak (nm)")

    return Result(
        checks=checks,
        tables={
            "": {
                "time (s)": np.linspace(*_SHOWN, len(single[0])),
                "runner, single slip (m)": single[1],
                "runner, two parts (m)": double[1],
            },
            **tables,
        },
        draw=draw,
        size=(6.2, 9.6),
        remark=(
            "Equal halves half a ringing period apart would do if the contact stayed elastic. It "
            "breaks away, so the first part has to be larger; the point in each map is the "
            "optimum. What the ringing loses the step pays for: the contact no longer slides "
            "through the whole stroke. Ringing: x - u, peak to peak, over three periods after "
            "the slip of a settled cycle."
        ),
    )


def _checks(preload: float, best: ShapedSlip) -> list[Check]:
    at = f"at {preload:g} N"
    return [
        Check(
            f"ringing, single slip over two parts, {at}",
            best.ringing_before / best.ringing_after,
            "",
            "the vibration vanishes",
            low=20.0,
        ),
        Check(f"ringing, single slip, {at}", NANO * best.ringing_before, "nm", kind=Kind.OURS),
        Check(f"step, single slip, {at}", NANO * best.step_before, "nm", kind=Kind.OURS),
        Check(f"step, two parts, {at}", NANO * best.step_after, "nm", kind=Kind.OURS),
        Check(
            f"first part, {at}",
            100.0 * best.split,
            "%",
            "half (another group's robot)",
            kind=Kind.OURS,
        ),
        Check(
            f"latency, {at}", best.latency / best.ringing_period, "ringing periods", kind=Kind.OURS
        ),
    ]


def _after_slip(p: Parameters) -> tuple[np.ndarray, np.ndarray]:
    """Return times from the begin of the first slip (s) and the runner from there (m)."""
    trace: Trace = trace_steps(p, 2)
    pattern = drive_of(p)
    slip = float(np.sum(pattern.durations[: pattern.slip]))
    t = np.linspace(*_SHOWN, 1500)
    x = np.interp(slip + t, trace.t, trace.x)
    return t, x - float(np.interp(slip, trace.t, trace.x))


ITEM = Item(
    name="shaping",
    title="Input shaping: a slip without vibration",
    place="Section 4.2",
    statement=(
        "Dividing the slip into two parts with a pause between them, as others have done with a "
        "mobile robot, cancels the vibration that follows it: the second part undoes the elastic "
        "deflection that the first has left."
    ),
    setup="CEIM, Table 1 at 0.4 and 1 N, 100 Hz; the best split and latency are searched for.",
    compute=compute,
)
