# SPDX-License-Identifier: Apache-2.0
"""``stickslip elongate``: the hold times around the slip that give the largest step."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict

from stickslip_ros.analysis import ElongatedStep, elongate_step, run_steps
from stickslip_ros.cli.options import (
    add_parameters,
    add_yaml,
    parameters_of,
    save_parameters,
    yaml_lines,
)
from stickslip_ros.compiled import telling_when_compiling
from stickslip_ros.parameters import Values


def add_parser(subparsers: argparse._SubParsersAction) -> None:  # type: ignore[type-arg]
    """Add the subcommand."""
    parser = subparsers.add_parser(
        "elongate",
        help="find the hold times around the slip that give the largest step",
        epilog="Holds help at high frequencies, such as --set frequency=10000.",
    )
    add_parameters(parser)
    parser.add_argument("--json", action="store_true", help="print one JSON object, SI units")
    add_yaml(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run the subcommand; return the exit code."""
    p = parameters_of(args)
    with telling_when_compiling():
        run_steps(p, 1)
    found = elongate_step(p)
    wanted: Values = {
        "waveform": "shaped" if p["waveform"] == "shaped" else "hold",
        "hold_before": found.hold_before,
        "hold_after": found.hold_after,
    }
    if args.yaml:
        save_parameters({**p, **wanted}, args.yaml)
    if args.json:
        print(json.dumps({**asdict(found), "parameters": {**p, **wanted}}, allow_nan=False))
    else:
        print(f"{_table(found)}\n\n{yaml_lines(wanted)}")
    return 0


def _table(found: ElongatedStep) -> str:
    rows = [
        ("", "without holds", "with holds"),
        ("step size", f"{1e9 * found.step_before:.3f} nm", f"{1e9 * found.step_after:.3f} nm"),
        ("hold before", "", f"{100 * found.hold_before:.2f} % of the period"),
        ("hold after", "", f"{100 * found.hold_after:.2f} % of the period"),
    ]
    return "\n".join(f"{name:<14}{before:<16}{after}".rstrip() for name, before, after in rows)
