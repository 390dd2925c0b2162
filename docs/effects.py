# SPDX-License-Identifier: Apache-2.0
"""Draws the pictures of docs/effects.md: what each effect does to a cycle.

python docs/effects.py
"""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("agg")

from matplotlib import pyplot
from matplotlib.axes import Axes

import stickslip_ros as ss

PAGES = Path(__file__).parent


def sensor(axes: Axes) -> None:
    """Draw the slip of a cycle as sensors show it."""
    exact = {"sensor_rate": 1e5, "sensor_noise": 0.0, "sensor_resolution": 0.0, "sensor_latency": 0}
    for label, values in {
        "runner": {},
        "2 kHz, first order": {"sensor_bandwidth": 2e3},
        "2 kHz, second order": {"sensor_bandwidth": 2e3, "sensor_order": 2},
        "20 kHz, 1 nm": {
            "sensor_bandwidth": 2e4, "sensor_noise": 1e-9,
        },
    }.items():  # fmt: skip
        seen = ss.simulate(steps=2, **{**exact, **values}).readings.between(0.0297, 0.0312)
        axes.plot(1e3 * (seen.t - 0.02), 1e9 * seen.x, label=label, linewidth=1)
    axes.set(xlabel="time since the start of the cycle (ms)", ylabel="reading (nm)")


def main() -> None:
    """Draw all."""
    for draw in (sensor,):
        figure, axes = pyplot.subplots(figsize=(7.0, 3.2), layout="constrained")
        draw(axes)
        axes.grid(alpha=0.3)
        axes.legend(fontsize="small")
        figure.savefig(PAGES / f"effects_{draw.__name__}.png", dpi=80)
        pyplot.close(figure)


if __name__ == "__main__":
    main()
