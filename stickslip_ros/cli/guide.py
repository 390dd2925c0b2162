# SPDX-License-Identifier: Apache-2.0
"""``stickslip guide``: the forces of the contacts that guide a runner."""

from __future__ import annotations

import argparse
import json
import math
from dataclasses import asdict

from stickslip_ros.cli.registered import GUIDE


def add_parser(subparsers: argparse._SubParsersAction) -> None:  # type: ignore[type-arg]
    """Add the subcommand."""
    parser = subparsers.add_parser(
        "guide",
        epilog="Use the ratio printed last with other subcommands: --set preload_ratio=...",
    )
    parser.add_argument("--mass", type=float, metavar="KG", default=3e-3, help="(default: 0.003)")
    parser.add_argument("--preload", type=float, metavar="N", default=0.2, help="(default: 0.2)")
    parser.add_argument(
        "--inclination",
        type=float,
        metavar="DEG",
        default=90.0,
        help="the paper's alpha, from the vertical to the axis: 90 (default) is level; the "
        "parameter `inclination` is different: rad above the horizontal",
    )
    for name, value in GUIDE.items():
        parser.add_argument(
            f"--{name}",
            type=float,
            metavar="M",
            default=value,
            help=f"Fig. 16 (default: {value:g})",
        )
    parser.add_argument("--json", action="store_true", help="print one JSON object, SI units")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run the subcommand; return the exit code."""
    from stickslip_ros.model.guide import Geometry, forces_by_preload, preload_ratio

    geometry = Geometry(args.a, args.b, args.c, args.e)
    forces = forces_by_preload(geometry, args.mass, math.radians(args.inclination), args.preload)
    ratio = preload_ratio(forces, args.preload)
    named = {name.upper(): force for name, force in asdict(forces).items()}
    if args.json:
        print(json.dumps({"forces": named, "sum": forces.total, "ratio": ratio}))
        return 0
    rows = [(name, f"{1e3 * force:8.1f} mN") for name, force in named.items()]
    rows += [("sum", f"{forces.total:8.3f} N"), ("preload", f"{args.preload:8.3f} N")]
    rows += [("ratio", f"{ratio:8.2f}")]
    print("\n".join(f"{name:<8}{value}" for name, value in rows))
    return 0
