# SPDX-License-Identifier: Apache-2.0
"""Draws the pictures that the tutorials open with: python docs/tutorials/pictures.py [FOLDER]."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import matplotlib

matplotlib.use("agg")

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import stickslip_ros as ss
from stickslip_ros.base.reporting import ACTUATOR, MEASURED, SIMULATED
from stickslip_ros.base.reporting.picture import save_picture
from stickslip_ros.measurement.twin import Twin, TwinCommand


def first_step(axes: Axes) -> None:
    """Draw three steps from rest."""
    ss.simulate(preload=0.5, steps=3).plot(axes)


def my_trace(axes: Axes) -> None:
    """Draw the slip between two steps of the sample, measured and simulated."""
    ss.compare("table1_typical.yaml", "steps_100hz.csv").plot(axes)
    axes.set(xlim=(49.0, 52.0), ylim=(640.0, 725.0), title="steps_100hz.csv")


def fit_my_drive(axes: Axes) -> None:
    """Draw the sample against a run whose stiffness is 20 % off, and against the fitted one."""
    measured = ss.read_measurement("steps_100hz.csv")
    guess = ss.Parameters.of({"preload": 0.4, "sigma_0": 7.2e6})
    fit = ss.identify([(guess, measured)], ["sigma_0", "sigma_1"], fit_lag=False)
    begin = fit.runs[0].start
    motions = {
        "measured": (measured, begin, "."),
        "stiffness 20 % too low": (ss.simulate(guess, steps=10).motion, 0.0, "-"),
        "fitted": (ss.simulate(fit.base, steps=10).motion, 0.0, "-"),
    }
    for name, (motion, start, style) in motions.items():
        seen = motion.between(start + 0.0499, start + 0.0512)
        t, x = 1e3 * (seen.t - start), 1e9 * (seen.x - seen.x[0])
        axes.plot(t, x, style, markersize=3, linewidth=1, label=name)
    axes.set(xlabel="time (ms)", ylabel="position (nm)", title="ringing after a slip")
    axes.legend()


def design_a_waveform(axes: Axes) -> None:
    """Draw the runner about a single and a shaped slip."""
    found = ss.shape_slip(preload=0.4)
    shaped = {"waveform": "shaped", "split": found.split, "latency": found.latency}
    for label, values in (("single slip", {}), ("slip in two parts", shaped)):
        run = ss.simulate(steps=12, preload=0.4, **values)
        t = np.linspace(0.1099, 0.1115, 1200)
        x = np.interp(t, run.trace.t, run.trace.x)
        axes.plot(1e3 * (t - 0.11), 1e9 * (x - x[0]), label=label, linewidth=1)
    axes.set(xlabel="time since the slip (ms)", ylabel="displacement (nm)")
    axes.legend()


def robot_tests(axes: Axes) -> None:
    """Draw what a test of a robot may see: a move, a push, a target beyond the limit."""
    axis = ss.Axis({"frequency": 1000.0, "preload": 0.5, "soft_high": 6e-6})
    axis.command("position", 5e-6)
    _draw_positions(axes, axis, 0.0, 0.15)
    axis.command("load", 0.02)
    _draw_positions(axes, axis, 0.15, 0.3)
    axes.axhline(6.0, color="#8c8c8c", linestyle="--", linewidth=0.8, label="soft limit")
    axes.axvline(150.0, color=ACTUATOR, linewidth=0.8, label="load of 20 mN")
    axes.legend()


def _draw_positions(axes: Axes, axis: ss.Axis, begin: float, end: float) -> None:
    """Let an axis run from one time (s) to another and draw its position meanwhile."""
    positions = []
    times = np.linspace(begin, end, round((end - begin) / 5e-4) + 1)
    for t in times.tolist():
        axis.advance(t)
        positions.append(axis.status.position)
    label = "" if begin else "position"
    axes.plot(1e3 * times, 1e6 * np.array(positions), color=SIMULATED, linewidth=1, label=label)
    axes.set(xlabel="time (ms)", ylabel="position (µm)")


def same_drive(axes: Axes) -> None:
    """Draw how far an axis is from its twin before and after its preload falls by a fifth."""
    axis, noise = ss.Axis({"frequency": 100.0}), np.random.default_rng(1)
    twin, updates = Twin(ss.Parameters.of(frequency=100.0)), []
    axis.command("steps", 600)
    twin.command(TwinCommand(0.0, "steps", 600))
    for number, t in enumerate(np.arange(0.013, 6.0, 0.01).tolist()):
        axis.advance(t)
        updates.append(twin.measure(t, axis.state.x + 2e-9 * noise.standard_normal()))
        if number == 299:
            axis.command("parameters", {"preload": 0.32})
    known = [one for one in updates if one]
    t, off, band = np.array([(u.t, u.measured - u.expected, 1.96 * u.deviation) for u in known]).T
    axes.fill_between(t, -1e9 * band, 1e9 * band, color=SIMULATED, alpha=0.2, linewidth=0)
    axes.plot(t, 1e9 * off, ".", color=MEASURED, markersize=3, label="measured - expected")
    axes.axvline(twin.changes[0].told, color=ACTUATOR, linewidth=0.8, label="change told")
    axes.set(xlabel="time (s)", ylabel="difference (nm)")
    axes.legend()


PICTURES: tuple[Callable[[Axes], None], ...] = (
    first_step, my_trace, fit_my_drive, design_a_waveform, robot_tests,
    same_drive,
)  # fmt: skip


def main(folder: Path) -> None:
    """Write all pictures into a folder."""
    for draw in PICTURES:
        figure = Figure(figsize=(6.7, 2.8), layout="constrained")
        axes = figure.add_subplot()
        draw(axes)
        axes.grid(alpha=0.3)
        save_picture(folder / f"{draw.__name__}.png", figure)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
