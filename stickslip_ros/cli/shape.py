# SPDX-License-Identifier: Apache-2.0
"""``stickslip shape``: the slip in two parts that leaves the least ringing."""

from __future__ import annotations

import argparse
from typing import Any

from stickslip_ros.cli.found_waveform import add_options, hand_on, parameters_to_begin_with
from stickslip_ros.studies.slip_shaping import ShapedSlip, shape_slip


def add_parser(subparsers: argparse._SubParsersAction) -> None:  # type: ignore[type-arg]
    """Add the subcommand."""
    parser = subparsers.add_parser(
        "shape",
        epilog="Amplitude, frequency and slewrate are set by --set, such as --set amplitude=200.",
    )
    add_options(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run the subcommand; return the exit code."""
    p = parameters_to_begin_with(args)
    found = shape_slip(p)
    wanted: dict[str, Any] = {"waveform": "shaped", "split": found.split, "latency": found.latency}
    if p.drive.waveform == "sawtooth":
        wanted |= {"hold_before": 0.0, "hold_after": 0.0}
    hand_on(args, found, p, wanted, _rows(found))
    return 0


def _rows(found: ShapedSlip) -> list[tuple[str, str, str]]:
    return [
        ("", "single slip", "shaped slip"),
        ("ringing", f"{1e9 * found.ringing_before:.3f} nm", f"{1e9 * found.ringing_after:.3f} nm"),
        ("step size", f"{1e9 * found.step_before:.3f} nm", f"{1e9 * found.step_after:.3f} nm"),
        ("split", "", f"{100 * found.split:.2f} %"),
        ("latency", "", f"{1e6 * found.latency:.3f} us"),
        ("", "", f"{found.latency / found.ringing_period:.3f} ringing periods"),
    ]
