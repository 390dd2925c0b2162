# SPDX-License-Identifier: Apache-2.0
"""Fig. 1 and 2: the response to a sawtooth, its seven phases and the points A to F."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
from matplotlib.figure import Figure

from stickslip_ros.model import drive_of, plant_of
from stickslip_ros.paper.item import Check, Item, Result
from stickslip_ros.paper.operating import NANO, RINGING
from stickslip_ros.parameters import Parameters
from stickslip_ros.traces.phases import points
from stickslip_ros.traces.response_plot import draw_closer, draw_cycles
from stickslip_ros.traces.trace import HEADER, trace_steps

#: A swing of the ringing that counts, m.
_SWING = 1e-9


def compute() -> Result:
    """Trace four cycles from rest and look at the first and second."""
    p = Parameters.of(RINGING)
    trace, pattern, contact = trace_steps(p, 4), drive_of(p), plant_of(p).contact
    cycles = [points(trace, pattern, contact, k) for k in range(3)]
    found = cycles[1]
    order = [found[name] for name in "ABCDEF"]

    def runner(t: float) -> float:
        return float(np.interp(t, trace.t, trace.x))

    first = cycles[0]
    backstep = max(trace.x[(trace.t >= found["C"]) & (trace.t <= found["D"])]) - runner(found["E"])
    ringing = trace.z[(trace.t > found["F"]) & (trace.t < cycles[2]["C"])]
    turned = np.flatnonzero(np.diff(np.sign(np.diff(ringing)))) + 1
    swings = int(np.sum(np.abs(ringing[turned]) > _SWING))

    def draw(figure: Figure) -> None:
        grid = figure.add_gridspec(3, 2)
        overview = figure.add_subplot(grid[0, :])
        draw_cycles(overview, trace, pattern, cycles)
        slipping = float(pattern.durations[pattern.slip])
        for place, names, window, what in (
            (grid[1, 0], "AB", (-10e-6, 400e-6), "the start: presliding"),
            (grid[1, 1], "CD", (-0.2 * slipping, slipping), "the slip of the actuator"),
            (grid[2, :], "CDEF", (-150e-6, 1500e-6), "backstep and ringing"),
        ):
            axes = figure.add_subplot(place)
            draw_closer(axes, trace, first, names, first[names[0]], window, what)
        handles, labels = overview.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=2, fontsize=8.5)

    return Result(
        checks=(
            Check(
                "points A to F that are out of order",
                float(np.sum(~(np.diff(order) > 0.0))),
                paper="A, B, C, D, E, F follow each other",
                high=0.0,
            ),
            Check("backstep in the slip", NANO * backstep, "nm", "the runner moves back", low=1.0),
            Check(
                "swings above 1 nm after the backstep",
                float(swings),
                paper="some damped vibration",
                low=3.0,
            ),
        ),
        tables={
            "": dict(zip(HEADER, (getattr(trace, f.name) for f in fields(trace)), strict=True))
        },
        draw=draw,
        size=(6.2, 9.0),
    )


ITEM = Item(
    name="fig02",
    title="Response to a sawtooth: seven phases, points A to F",
    place="Fig. 1 and 2, section 2",
    statement=(
        "A step is more than stick and slip: presliding, stick, slowdown, presliding the other "
        "way, slip and slowdown follow each other (points A to F). The slip throws the runner "
        "back, and a damped vibration follows."
    ),
    setup="CEIM, Table 1 with sigma_0 = 2.53e6 N/m from its vibration of 4 kHz (Eq. 11); 100 Hz.",
    compute=compute,
)
