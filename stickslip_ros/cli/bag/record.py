# SPDX-License-Identifier: Apache-2.0
"""``stickslip bag record``: record topics until told to stop."""

from __future__ import annotations

import argparse

from stickslip_ros.cli.bag.nodes import run_node
from stickslip_ros.recordings import COMPRESSIONS


def add_parser(subparsers: argparse._SubParsersAction) -> None:  # type: ignore[type-arg]
    """Add the subcommand."""
    parser = subparsers.add_parser(
        "record",
        help="record topics until Ctrl-C; without any named, all topics of the axis",
        epilog="Also as a node, ros2 run stickslip_ros recorder_node, with the same options as "
        "parameters and the services ~/start, ~/stop and ~/split.",
    )
    parser.add_argument("topics", nargs="*", metavar="TOPIC", help="names of topics")
    parser.add_argument("--regex", metavar="R", help="every topic whose full name matches, too")
    parser.add_argument(
        "--axis", action="append", metavar="NODE", help="axis node (default: /stickslip_axis)"
    )
    parser.add_argument(
        "--out", metavar="DIR", help="new folder (default: stickslip_<date>-<time> right here)"
    )
    parser.add_argument("--compression", choices=COMPRESSIONS, help="of chunks (default: none)")
    parser.add_argument(
        "--max-size", type=float, metavar="MB", help="begin a new file after (default: never)"
    )
    parser.add_argument(
        "--max-duration", type=float, metavar="S", help="begin a new file after (default: never)"
    )
    parser.add_argument(
        "--no-fsync",
        dest="fsync",
        action="store_false",
        default=None,
        help="bring the bag to the disk at its end only; a power cut may cost all of it",
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
