# SPDX-License-Identifier: Apache-2.0
"""Sets of parameters at random: every law, waveform and load, and the corners of the ranges."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Any

import numpy as np

from stickslip_ros.model import LAWS, Plant, drive_of
from stickslip_ros.parameters import PARAMETERS, ParameterError, Parameters
from validation.draws import REAL, corner, even, loads, shape, waveform

#: Drawn evenly in their logarithm: spans of real drives, a sharper edge and a wider frequency
_SPANS = {
    **{name: REAL[name] for name in ("preload", "mass", "sigma_1", "sigma_0", "sigma_0ss")},
    **{"mu_s": REAL["mu_s"], "mu_k": REAL["mu_k"], "v_stribeck": (1e-6, 1.0), "z_ba": REAL["z_ba"]},
    **{"frequency": (20.0, 5e4), "slewrate": (10.0, 1000.0), "amplitude": REAL["amplitude"]},
}
#: What is there in some sets only: how often, and the span
_SOMETIMES = {
    "sigma_2": (0.3, (1e-9, 10.0)),
    "payload": (0.1, REAL["payload"]),
    "spring": (0.25, REAL["spring"]),
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
            values[name] = even(draw, low, high)
    for name, (share, (low, high)) in _SOMETIMES.items():
        if draw.random() < share:
            values[name] = even(draw, low, high)
    values |= loads(draw, values["preload"])
    values["waveform"] = waveform(draw)
    values |= shape(draw, values)
    if corners:
        for name in draw.choice(_CORNERS, 3, replace=False):
            values[str(name)] = corner(draw, PARAMETERS[str(name)])
    return values
