# SPDX-License-Identifier: Apache-2.0
"""What random sets of parameters are drawn by: numbers over their ranges, waveforms and loads."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from stickslip_ros.physics.parameters import PARAMETERS, Parameters
from stickslip_ros.physics.parameters.row import Parameter

#: Narrower than the table: what real drives and those of the paper span, and a decade beyond
REAL = {
    "preload": (0.05, 20.0),
    "mass": (1e-4, 1.0),
    "mu": (0.05, 1.0),
    "sigma_1": (0.5, 100.0),
    "sigma_0": (1e5, 1e8),
    "sigma_0ss": (1e6, 1e8),
    "mu_s": (0.05, 1.0),
    "mu_k": (0.05, 1.0),
    "v_stribeck": (1e-5, 1.0),
    "z_ba": (1e-9, 1e-6),
    "z_ss": (1e-9, 1e-6),
    "slewrate": (1.0, 1000.0),
    "amplitude": (10.0, 300.0),
    "spring": (1e2, 1e6),
    "payload": (1e-3, 0.1),
    "sigma_2": (1e-6, 10.0),
    "amplifier_bandwidth": (1e3, 1e7),
    "amplifier_slew": (0.01, 1000.0),
    "actuator_resonance": (1e4, 1e7),
    "wear_rate": (1.0, 1e4),
    "temperature": (2.0, 500.0),
    "gain_temperature": (1e-5, 3.3e-3),
    "friction_temperature": (1e-5, 3.3e-3),
}
#: Share of the friction that a constant load takes at most; more carries a runner off
MOST_LOAD = 0.3
#: Of a row whose range begins at 0: how far below its most numbers are drawn, and how far some are
_DECADES_BELOW, _SMALLEST = 1e-9, 1e-300


def even(draw: np.random.Generator, low: float, high: float) -> float:
    """Draw evenly in the logarithm."""
    return float(math.exp(draw.uniform(math.log(low), math.log(high))))


def anywhere(draw: np.random.Generator, name: str, narrow: tuple[float, float] | None) -> float:
    """Draw evenly in the logarithm, from the whole range of the table if no other is given."""
    row = PARAMETERS[name]
    low, high = narrow or (float(max(row.low, row.least)), float(row.high))
    if name == "amplitude":
        high = min(high, Parameters().actuator.max_voltage)
    if low < 1e-12 * high and not row.low:  # off in the table: from a millionth of the most
        low = max(row.least, 1e-6 * high)
    return even(draw, low, high)


def corner(draw: np.random.Generator, row: Parameter) -> float:
    """Draw from the whole range of a parameter, its ends and what is smaller than any use."""
    least = max(row.least, row.low)
    if row.kind is int:
        first, last = int(row.low), int(row.high)
        return int(draw.choice([first, last, int(draw.integers(first, last + 1))]))
    ends = (row.low, row.high, least, math.nextafter(row.high, 0.0))
    if draw.random() < 0.01:
        return math.ulp(0.0)
    if draw.random() < 0.2:
        value = ends[draw.integers(len(ends))]
    else:
        high = max(abs(row.low), row.high)
        low = max(least, _DECADES_BELOW * high if draw.random() < 0.8 else _SMALLEST)
        value = even(draw, min(low, high), high)
        value = -value if row.low < 0.0 and draw.random() < 0.5 else min(value, row.high)
    return float(value)


def waveform(draw: np.random.Generator) -> str:
    """Draw a waveform that needs no file."""
    return str(draw.choice(["sawtooth", "sawtooth", "hold", "shaped", "triangle"]))


def loads(draw: np.random.Generator, preload: float, mu: float = 1.0) -> dict[str, float]:
    """Draw a constant force, part of the friction (N), and an inclination; most have neither."""
    values = {}
    if draw.random() < 0.3:
        values["force"] = float(draw.uniform(-MOST_LOAD, MOST_LOAD)) * mu * preload
    if draw.random() < 0.2:
        values["inclination"] = float(draw.uniform(-math.pi, math.pi))
    return values


def shape(draw: np.random.Generator, values: dict[str, Any]) -> dict[str, float]:
    """Draw what the waveform of the values needs besides their frequency (Hz)."""
    if values["waveform"] == "hold":
        before, after = (float(x) for x in draw.uniform(0, 0.4, 2))
        return {"hold_before": before, "hold_after": after}
    if values["waveform"] == "shaped":
        split = float(draw.uniform(0.1, 0.9))
        return {"split": split, "latency": float(draw.uniform(0.0, 0.3)) / values["frequency"]}
    return {}


def differing(p: Parameters) -> dict[str, Any]:
    """Return what is not as in the table, as a repeat needs it."""
    default = Parameters().flat()
    return {name: value for name, value in p.flat().items() if value != default[name]}
