# SPDX-License-Identifier: Apache-2.0
"""The sliders of the page: their parameters, ranges and units; the texts to copy."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping
from typing import Any, NamedTuple

from stickslip_ros.physics.model import LAWS, WAVEFORMS
from stickslip_ros.physics.model.friction import constants_in_force
from stickslip_ros.physics.parameters import PARAMETERS, ParameterError, Parameters, yaml_text
from stickslip_ros.physics.parameters.row import Value


class Slider(NamedTuple):
    """One parameter on the page."""

    name: str
    label: str
    low: float  #: end of the slider, in the unit shown; a number beyond it may be typed
    high: float
    unit: str  #: as shown
    factor: float  #: SI units in one unit shown
    log: bool = True  #: whether the slider moves by factors


#: The sliders by the heading that they stand under.
GROUPS: Mapping[str, tuple[Slider, ...]] = {
    "Drive": (
        Slider("amplitude", "amplitude", 1, 300, "V", 1, False),
        Slider("frequency", "frequency", 1, 20_000, "Hz", 1),
        Slider("slewrate", "slewrate of the slip", 5, 1000, "V/µs", 1),
    ),
    "Contact": (
        Slider("preload", "preload", 0.02, 10, "N", 1),
        Slider("sigma_0", "stiffness σ₀", 0.2, 100, "N/µm", 1e6),
        Slider("sigma_1", "damping σ₁", 0.1, 200, "N s/m", 1),
        Slider("z_ba", "breakaway distance", 1, 1000, "nm", 1e-9),
        Slider("sigma_0ss", "plastic stiffness σ₀,ss", 1, 1000, "N/µm", 1e6),
    ),
    "Runner and loads": (
        Slider("mass", "mass", 0.5, 100, "g", 1e-3),
        Slider("force", "external force", -1, 1, "N", 1, False),
        Slider("inclination", "inclination", -90, 90, "°", math.pi / 180, False),
    ),
    "Waveform": (
        Slider("hold_before", "hold before the slip", 0, 90, "% of the period", 0.01, False),
        Slider("hold_after", "hold after the slip", 0, 90, "% of the period", 0.01, False),
        Slider("split", "first part of a shaped slip", 0, 100, "%", 0.01, False),
        Slider("latency", "time between its parts", 0, 500, "µs", 1e-6, False),
    ),
}
SLIDERS = {slider.name: slider for group in GROUPS.values() for slider in group}
#: The parameters that are chosen from a list.
CHOICES: Mapping[str, tuple[str, ...]] = {
    "model": tuple(LAWS),
    "waveform": tuple(name for name in WAVEFORMS if name != "table"),
}
#: Steps of the runs that the page offers to copy.
_STEPS = 30


def read_changes(texts: Mapping[str, str]) -> dict[str, Value]:
    """Return values by name as the page sends them: SI units, an empty text for "not set".

    Raises ParameterError for what is no control of the page, and for no number.
    """
    found: dict[str, Value] = {}
    for name, text in texts.items():
        if name not in SLIDERS and name not in CHOICES:
            raise ParameterError(f"there is no control {name!r} on the page")
        row = PARAMETERS[name]
        found[name] = row.kind() if row.optional and not text else row.read(text)
    return found


def shown_values(p: Parameters) -> dict[str, Any]:
    """Return the values of the controls, sliders in their units; where unset, the law's own."""
    flat, own = p.flat(), constants_in_force(p.friction)
    found: dict[str, Any] = {name: flat[name] for name in CHOICES}
    for name, slider in SLIDERS.items():
        value = flat[name]
        if PARAMETERS[name].optional and not value:
            value = getattr(own, name, None) or 0.0
        found[name] = float(f"{float(value) / slider.factor:.6g}")
    return found


def set_names(p: Parameters) -> list[str]:
    """Return the optional parameters that are set, not left to the friction law."""
    flat = p.flat()
    return [name for name in SLIDERS if PARAMETERS[name].optional and flat[name]]


def recipes(p: Parameters, direction: int = 1) -> dict[str, str]:
    """Return texts by name that describe the drive, with the values that differ from the defaults.

    >>> print(recipes(Parameters.of({"preload": 0.5}))["Command"])
    stickslip simulate --steps 30 --set preload=0.5
    """
    usual = Parameters().flat()
    changed = {name: value for name, value in p.flat().items() if value != usual[name]}
    steps = direction * _STEPS
    keywords = "".join(f"    {name}={value!r},\n" for name, value in changed.items())
    settings = [word for name, value in changed.items() for word in ("--set", f"{name}={value}")]
    return {
        "YAML": yaml_text(p) if changed else "/**:\n  ros__parameters: {}\n",
        "Python": "import stickslip_ros as ss\n\n"
        f"run = ss.simulate(\n{keywords}    steps={steps},\n)\nprint(run)\n",
        "Command": shlex.join(["stickslip", "simulate", "--steps", str(steps), *settings]),
    }
