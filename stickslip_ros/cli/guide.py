# SPDX-License-Identifier: Apache-2.0
"""``stickslip guide``: the forces of the contacts that guide a runner."""

from __future__ import annotations

import argparse
import math
from dataclasses import asdict

from stickslip_ros.cli.options import add_outputs, option, print_result, quantity


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the subcommand."""
    parser.epilog = "Use the ratio printed last with other subcommands: --set preload_ratio=..."
    option(parser, "--mass", "KG", "(default: 3g)", quantity("kg"), default=3e-3)
    option(parser, "--preload", "N", "(default: 0.2N)", quantity("N"), default=0.2)
    text = (
        "the paper's alpha, from the vertical to the axis: 90 (default) is level; the parameter "
        "`inclination` is different: rad above the horizontal"
    )
    option(parser, "--inclination", "DEG", text, quantity("deg"), default=90.0)
    for name in "abce":
        text = "length of Fig. 16 (default: that of the paper's guide)"
        option(parser, f"--{name}", "M", text, quantity("m"))
    add_outputs(parser)


def run(args: argparse.Namespace) -> int:
    """Run the subcommand; return the exit code."""
    from stickslip_ros.model.guide import Geometry, forces_by_preload, preload_ratio

    given = {name: getattr(args, name) for name in "abce"}
    geometry = Geometry(**{name: length for name, length in given.items() if length is not None})
    forces = forces_by_preload(geometry, args.mass, math.radians(args.inclination), args.preload)
    ratio = preload_ratio(forces, args.preload)
    named = {name.upper(): force for name, force in asdict(forces).items()}
    rows = [(name, f"{1e3 * force:8.1f} mN") for name, force in named.items()]
    rows += [("sum", f"{forces.total:8.3f} N"), ("preload", f"{args.preload:8.3f} N")]
    rows += [("ratio", f"{ratio:8.2f}")]
    content = {"forces": named, "sum": forces.total, "ratio": ratio}
    print_result(args, content, lambda: "\n".join(f"{name:<8}{value}" for name, value in rows))
    return 0
