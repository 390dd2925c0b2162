# SPDX-License-Identifier: Apache-2.0
"""``stickslip predict``: the step in closed form, and the amplitude for a wanted step."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict

from stickslip_ros.cli.options import (
    EFFECTS,
    add_drive,
    add_outputs,
    option,
    parameters_of,
    quantity,
    report_left_out,
)
from stickslip_ros.reporting import format_si
from stickslip_ros.reporting.terminal import format_rows


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the subcommand."""
    parser.epilog = (
        "step = stroke - a0, at low frequency and steep slip; an axis outside of its range "
        "is refused. docs/prediction.md has the equation and its error."
    )
    text = "find the amplitude that makes this step"
    option(parser, "--step", "M", text, quantity("m"))
    add_drive(parser)
    add_outputs(parser)


def run(args: argparse.Namespace) -> int:
    """Run the subcommand; return the exit code."""
    from stickslip_ros.library.prediction import predict

    p = parameters_of(args)
    report_left_out(p, "predict", EFFECTS)
    found = predict(p, step=args.step)
    if args.json:
        print(json.dumps(asdict(found), allow_nan=False))
        return 0
    rows = [
        ("amplitude", f"{found.amplitude:.5g} V"),
        ("stroke", format_si(found.stroke, "m", 5)),
        ("a0", format_si(found.zero_offset, "m", 4)),
        ("step", f"{format_si(found.step, 'm', 5)}, within {format_si(found.error, 'm', 2)}"),
    ]
    print(format_rows(rows))
    return 0
