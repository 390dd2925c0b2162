# SPDX-License-Identifier: Apache-2.0
"""Sets of parameters at random: every law, waveform and load, and the corners of the ranges."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from stickslip_ros.model import LAWS, Plant, drive_of
from stickslip_ros.parameters import PARAMETERS, ParameterError, Parameters

#: What real drives and those of the paper span, and a decade or two beyond; drawn evenly in their
#: logarithm.
_SPANS = {
    "preload": (0.05, 20.0),
    "mass": (1e-4, 1.0),
    "sigma_1": (0.5, 100.0),
    "sigma_0": (1e5, 1e8),
    "sigma_0ss": (1e6, 1e8),
    "mu_s": (0.05, 1.0),
    "mu_k": (0.05, 1.0),
    "v_stribeck": (1e-6, 1.0),
    "z_ba": (1e-9, 1e-6),
    "frequency": (20.0, 5e4),
    "slewrate": (10.0, 1000.0),
    "amplitude": (10.0, 300.0),
}
#: What is there in some sets only: how often, and the span
_SOMETIMES = {
    "sigma_2": (0.3, (1e-9, 10.0)),
    "payload": (0.1, (1e-3, 0.1)),
    "spring": (0.25, (1e2, 1e6)),
    "sigma_0_cap": (0.1, (0.1, 10.0)),
}
#: Numbers of the table whose corners are drawn too
_CORNERS = (
    *("preload", "mass", "sigma_0", "sigma_0ss", "sigma_1", "sigma_2", "mu_s", "mu_k"),
    *("v_stribeck", "z_ba", "z_ss", "force", "spring", "payload", "slewrate", "mu"),
)

#: Laws of the form of `Contact`, which the reference integrates
_LAWS = [name for name, law in LAWS.items() if not law.rate]


def random_sets(seed: int, corners: bool = False, first: int = 0) -> Iterator[Parameters]:
    """Yield sets that make an axis, for ever, from number first on.

    A set follows from the seed and its number alone. With corners, some numbers are drawn from all
    of their range, its ends included.
    """
    for number in itertools.count(first):
        draw = np.random.default_rng((seed, number))
        while True:
            try:
                p = Parameters.of(_drawn(draw, corners))
                Plant.of(p)
                drive_of(p)
            except ParameterError:
                continue
            yield p
            break


def _drawn(draw: np.random.Generator, corners: bool) -> dict[str, Any]:
    values: dict[str, Any] = {"model": str(draw.choice(_LAWS))}
    values["alpha_form"] = str(draw.choice(["dupont", "dupont", "printed"]))
    own = () if draw.random() < 0.5 else ("sigma_0", "z_ba", "sigma_0ss")
    for name, (low, high) in _SPANS.items():
        if name not in ("sigma_0", "z_ba", "sigma_0ss") or name in own:
            values[name] = _even(draw, low, high)
    for name, (share, (low, high)) in _SOMETIMES.items():
        if draw.random() < share:
            values[name] = _even(draw, low, high)
    if draw.random() < 0.3:
        values["force"] = float(draw.uniform(-0.3, 0.3)) * values["preload"]
    if draw.random() < 0.2:
        values["inclination"] = float(draw.uniform(-math.pi, math.pi))
    values["waveform"] = str(draw.choice(["sawtooth", "sawtooth", "hold", "shaped", "triangle"]))
    if values["waveform"] == "hold":
        values["hold_before"], values["hold_after"] = (float(x) for x in draw.uniform(0, 0.4, 2))
    if values["waveform"] == "shaped":
        values["split"] = float(draw.uniform(0.1, 0.9))
        values["latency"] = float(draw.uniform(0.0, 0.3)) / values["frequency"]
    if corners:
        for name in draw.choice(_CORNERS, 3, replace=False):
            values[str(name)] = _corner(draw, str(name))
    return values


def _even(draw: np.random.Generator, low: float, high: float) -> float:
    """Draw evenly in the logarithm."""
    return float(math.exp(draw.uniform(math.log(low), math.log(high))))


def _corner(draw: np.random.Generator, name: str) -> float:
    """Draw from the whole range of a parameter: an end of it, or anywhere, small numbers too."""
    row = PARAMETERS[name]
    choice = draw.integers(4)
    if choice == 0:
        return row.low
    if choice == 1:
        return row.high
    size = _even(draw, max(row.low, row.least or 1e-300), row.high)
    return -size if row.low < 0.0 and draw.random() < 0.5 else size
