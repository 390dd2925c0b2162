# SPDX-License-Identifier: Apache-2.0
"""``stickslip elongate``: the hold times around the slip that give the largest step."""

from __future__ import annotations

import argparse
from typing import Any

from stickslip_ros.cli import shape
from stickslip_ros.cli.options import check_outputs, parameters_from
from stickslip_ros.cli.shape import write_search_result
from stickslip_ros.reporting.terminal import announce_if_slow


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the subcommand."""
    shape.arguments(parser)
    parser.epilog = "Hold times help at high frequencies, such as --set frequency=10000."


def run(args: argparse.Namespace) -> int:
    """Run the subcommand; return the exit code."""
    from stickslip_ros.library.waveform_search import elongate_step

    check_outputs(args, args.yaml)
    p = parameters_from(args)
    with announce_if_slow("searching the hold times of the largest step", in_pipes=True):
        found = elongate_step(p)
    wanted: dict[str, Any] = {
        "waveform": "shaped" if p.drive.waveform == "shaped" else "hold",
        "hold_before": found.hold_before,
        "hold_after": found.hold_after,
    }
    rows = [
        ("", "without holds", "with holds"),
        ("step size", f"{1e9 * found.step_before:.3f} nm", f"{1e9 * found.step_after:.3f} nm"),
        ("hold before", "", f"{100 * found.hold_before:.2f} % of the period"),
        ("hold after", "", f"{100 * found.hold_after:.2f} % of the period"),
    ]
    write_search_result(args, found, p, wanted, rows)
    return 0
