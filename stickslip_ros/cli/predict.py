# SPDX-License-Identifier: Apache-2.0
"""``stickslip predict``: the step in closed form, and the amplitude for a wanted step."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict

from stickslip_ros.cli.options import EFFECTS, add_parameters, parameters_of, tell_left_out
from stickslip_ros.reporting import shown
from stickslip_ros.reporting.terminal import lines_of


def add_parser(subparsers: argparse._SubParsersAction) -> None:  # type: ignore[type-arg]
    """Add the subcommand."""
    parser = subparsers.add_parser(
        "predict",
        epilog="step = stroke - a0, at low frequency and steep slip; an axis outside of its range "
        "is refused. docs/prediction.md has the equation and its error.",
    )
    parser.add_argument("--amplitude", type=float, metavar="V", help="peak to peak")
    parser.add_argument("--frequency", type=float, metavar="HZ")
    parser.add_argument(
        "--step", type=float, metavar="M", help="find the amplitude that makes this step, m"
    )
    add_parameters(parser)
    parser.add_argument("--json", action="store_true", help="print one JSON object, SI units")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run the subcommand; return the exit code."""
    from stickslip_ros.library.prediction import predict

    p = parameters_of(args, amplitude=args.amplitude, frequency=args.frequency)
    tell_left_out(p, "predict", EFFECTS)
    found = predict(p, step=args.step)
    if args.json:
        print(json.dumps(asdict(found), allow_nan=False))
        return 0
    rows = [
        ("amplitude", f"{found.amplitude:.5g} V"),
        ("stroke", shown(found.stroke, "m", 5)),
        ("a0", shown(found.zero_offset, "m", 4)),
        ("step", f"{shown(found.step, 'm', 5)}, within {shown(found.error, 'm', 2)}"),
    ]
    print(lines_of(rows))
    return 0
