# SPDX-License-Identifier: Apache-2.0
"""What the page offers to copy: the same drive as YAML, as Python and as a command."""

from __future__ import annotations

import shlex

from stickslip_ros.parameters import Parameters, yaml_text

_STEPS = 30


def recipes(p: Parameters, direction: int = 1) -> dict[str, str]:
    """Return texts by name that describe the drive; each holds what differs from the defaults.

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
