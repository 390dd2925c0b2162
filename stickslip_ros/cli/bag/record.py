# SPDX-License-Identifier: Apache-2.0
"""``stickslip bag record``: record topics until stopped."""

from __future__ import annotations

import argparse

from stickslip_ros.cli.options import run_node
from stickslip_ros.cli.registered import COMPRESSIONS


def add_parser(subparsers: argparse._SubParsersAction) -> None:  # type: ignore[type-arg]
    """Add the subcommand."""
    parser = subparsers.add_parser(
        "record",
        help="record topics until Ctrl-C (default: all topics of the axis)",
        epilog="Also as a node, ros2 run stickslip_ros recorder_node, with the same options as "
        "parameters and the services ~/start, ~/stop and ~/split.",
    )
    parser.add_argument("topics", nargs="*", metavar="TOPIC", help="topics to record")
    parser.add_argument("--regex", metavar="R", help="also every topic whose full name matches")
    parser.add_argument(
        "--axis", action="append", metavar="NODE", help="axis node (default: /stickslip_axis)"
    )
    parser.add_argument(
        "--out", metavar="DIR", help="new folder (default: stickslip_<date>-<time>)"
    )
    parser.add_argument(
        "--compression", choices=COMPRESSIONS, help="compress chunks (default: none)"
    )
    parser.add_argument(
        "--max-size", type=float, metavar="MB", help="size for a new file (default: never)"
    )
    parser.add_argument(
        "--max-duration", type=float, metavar="S", help="time for a new file (default: never)"
    )
    parser.add_argument(
        "--no-fsync",
        dest="fsync",
        action="store_false",
        default=None,
        help="write the bag to the disk only at the end; a power cut may lose all of it",
    )
    parser.add_argument(
        "--status", type=float, metavar="S", help="time between status lines (default: 10)"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run the subcommand; return the exit code."""
    return run_node(
        "stickslip bag record",
        "recorder_node",
        "RecorderNode",
        {
            "topics": args.topics or None,
            "regex": args.regex,
            "axes": args.axis,
            "output": args.out,
            "compression": args.compression,
            "max_size": args.max_size,
            "max_duration": args.max_duration,
            "fsync": args.fsync,
            "status_period": args.status,
        },
    )
