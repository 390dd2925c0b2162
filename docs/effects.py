# SPDX-License-Identifier: Apache-2.0
"""Draws the pictures of docs/effects.md: what each effect does to a cycle.

python docs/effects.py
"""

from __future__ import annotations

from pathlib import Path

import matplotlib
import numpy as np

matplotlib.use("agg")

from cycler import cycler
from matplotlib import pyplot
from matplotlib.axes import Axes

import stickslip_ros as ss
from stickslip_ros.axis import Axis
from stickslip_ros.physics.model import Plant
from stickslip_ros.physics.model.waveforms import command_of
from stickslip_ros.physics.parameters import Parameters
from stickslip_ros.physics.solver.driven import simulation_of

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
        axes.plot(1e3 * (seen.t - 0.02), 1e9 * seen.x, label=label, linewidth=1.3)
    axes.set(xlabel="time since the start of the cycle (ms)", ylabel="reading (nm)")


def slip(axes: Axes) -> None:
    """Draw the actuator around a slip."""
    effects = {
        "command": {},
        "amplifier, 200 kHz": {"amplifier_bandwidth": 2e5},
        "current limit, 60 V/us": {"amplifier_bandwidth": 1e6, "amplifier_slew": 60.0},
        "resonance, 200 kHz, 0.2": {"actuator_resonance": 2e5, "actuator_damping": 0.2},
    }
    for label, values in effects.items():
        p = Parameters.of({"frequency": 1000.0, **values})
        simulation = simulation_of(p, Plant.of(p))
        simulation.start(command_of(p), 2)
        t = np.linspace(9.9e-4, 1.02e-3, 1500)
        axes.plot(1e6 * (t - 1e-3), 1e9 * simulation.sample(t).u, label=label, linewidth=1.3)
    axes.set(xlabel="time since the end of the slip (us)", ylabel="deflection (nm)")


def creep(axes: Axes) -> None:
    """Draw the way of an actuator up and down in two levels."""
    effects = {
        "linear": {},
        "hysteresis, 15 %": {"actuator": "hysteresis", "actuator_memory": True},
        "and creep, 2 % a decade": {
            "actuator": "hysteresis", "actuator_memory": True, "creep": 0.02,
        },
    }  # fmt: skip
    for label, values in effects.items():
        axis = Axis(values)
        times, found = np.linspace(0.0, 8.0, 801), []
        commands = {100: 150.0, 300: 300.0, 500: 150.0, 700: 0.0}
        for k, t in enumerate(times):
            axis.advance(float(t))
            if k in commands:
                axis.command("scan", commands[k])
            found.append(1e9 * axis.state.u)
        axes.plot(times, found, label=label, linewidth=1.3)
    axes.set(xlabel="time (s)", ylabel="deflection (nm)")


def surface(axes: Axes) -> None:
    """Draw the steps to one side and back over the same place."""
    p = Parameters.of({"surface_spread": 0.15, "surface_length": 1e-6, "slip_spread": 0.02})
    simulation = simulation_of(p, Plant.of(p))
    for sign, label in ((1, "forward"), (-1, "and back")):
        simulation.start(command_of(p, sign), 100)
        start = simulation.x
        x = np.append(start, simulation.run_cycles(100).position)
        axes.plot(1e6 * x[:-1], 1e9 * np.abs(np.diff(x)), ".-", label=label, linewidth=1.3)
    axes.set(xlabel="position (um)", ylabel="step (nm)")


def contacts(axes: Axes) -> None:
    """Draw a slip of runners on contacts that give way together or one by one."""
    for label, values in {
        "one contact": {},
        "six of the guide": {"contacts": 6, "contact_shares": "guide"},
        "six, spread 0.3": {"contacts": 6, "contact_shares": "guide", "contact_spread": 0.3},
    }.items():
        p = Parameters.of({"frequency": 1000.0, **values})
        simulation = simulation_of(p, Plant.of(p))
        simulation.start(command_of(p), 3)
        simulation.run_cycles(1)
        t = 2e-3 + np.linspace(-5e-5, 3e-4, 3000)
        x = 1e9 * simulation.sample(t).x
        axes.plot(1e6 * (t - 2e-3), x - x[0], label=label, linewidth=1.3)
    axes.set(xlabel="time since the end of the slip (us)", ylabel="moved (nm)")


def ageing(axes: Axes) -> None:
    """Draw the first slip after rests, of a contact that grows stronger meanwhile."""
    p = Parameters.of({"dwell_growth": 0.06, "dwell_start": 1e-3})
    for rest in (0.0, 1.0, 1e3):
        simulation = simulation_of(p, Plant.of(p))
        simulation.start(command_of(p), 3)
        simulation.run_cycles(3)
        simulation.advance(0.03 + rest)
        start = simulation.t
        simulation.start(command_of(p), 2)
        t = start + np.linspace(9.9e-3, 11e-3, 1500)
        x = 1e9 * simulation.sample(t).x
        label = f"after {rest:g} s" if rest else "in a move"
        axes.plot(1e3 * (t - start - 0.01), x - x[0], label=label, linewidth=1.3)
    axes.set(xlabel="time since the end of the slip (ms)", ylabel="moved since the stick (nm)")


def main() -> None:
    """Draw all."""
    colours = pyplot.rcParams["axes.prop_cycle"][:4]
    pyplot.rcParams["axes.prop_cycle"] = colours + cycler(linestyle=["-", "--", "-.", ":"])
    for draw in (sensor, slip, creep, contacts, surface, ageing):
        figure, axes = pyplot.subplots(figsize=(7.0, 3.2), layout="constrained")
        draw(axes)
        axes.grid(alpha=0.3)
        axes.legend(fontsize="small")
        figure.savefig(PAGES / f"effects_{draw.__name__}.png", dpi=115)
        pyplot.close(figure)


if __name__ == "__main__":
    main()
