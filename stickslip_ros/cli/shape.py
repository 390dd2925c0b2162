# SPDX-License-Identifier: Apache-2.0
"""``stickslip shape``: the slip in two parts that leaves the least ringing."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict

from stickslip_ros.analysis import ShapedSlip, run_steps, shape_slip
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
        "shape",
        help="find the slip in two parts that leaves the least ringing",
        epilog="Amplitude, frequency and slewrate are set by --set, such as --set amplitude=200.",
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
    found = shape_slip(p)
    wanted: Values = {"waveform": "shaped", "split": found.split, "latency": found.latency}
    if p["waveform"] == "sawtooth":
        wanted |= {"hold_before": 0.0, "hold_after": 0.0}
    if args.yaml:
        save_parameters({**p, **wanted}, args.yaml)
    if args.json:
        print(json.dumps({**asdict(found), "parameters": {**p, **wanted}}, allow_nan=False))
    else:
        print(f"{_table(found)}\n\n{yaml_lines(wanted)}")
    return 0


def _table(found: ShapedSlip) -> str:
    rows = [
        ("", "single slip", "shaped slip"),
        ("ringing", f"{1e9 * found.ringing_before:.3f} nm", f"{1e9 * found.ringing_after:.3f} nm"),
        ("step size", f"{1e9 * found.step_before:.3f} nm", f"{1e9 * found.step_after:.3f} nm"),
        ("split", "", f"{100 * found.split:.2f} %"),
        ("latency", "", f"{1e6 * found.latency:.3f} us"),
        ("", "", f"{found.latency / found.ringing_period:.3f} ringing periods"),
    ]
    return "\n".join(f"{name:<12}{before:<16}{after}".rstrip() for name, before, after in rows)
