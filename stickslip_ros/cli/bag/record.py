# SPDX-License-Identifier: Apache-2.0
"""``stickslip bag record``: record topics until stopped."""

from __future__ import annotations

import argparse

from stickslip_ros.cli.options import option, quantity, run_node


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the action."""
    parser.epilog = (
        "Also as a node, ros2 run stickslip_ros recorder_node, with the same options as "
        "parameters and the services ~/start, ~/stop and ~/split."
    )
    option(parser, "topics", "TOPIC", "topics to record", nargs="*")
    option(parser, "--regex", "R", "also every topic whose full name matches")
    text = "axis node (default: /stickslip_axis)"
    parser.add_argument("--axis", action="append", metavar="NODE", help=text)
    option(parser, "--out", "DIR", "new folder (default: stickslip_<date>-<time>)")
    option(parser, "--compression", "none|lz4|zstd", "compress chunks (default: none)")
    option(parser, "--max-size", "MB", "size for a new file (default: never)", float)
    option(parser, "--max-duration", "S", "time for a new file (default: never)", quantity("s"))
    text = "write the bag to the disk only at the end; a power cut may lose all of it"
    parser.add_argument("--no-fsync", dest="fsync", action="store_false", default=None, help=text)
    option(parser, "--status", "S", "time between status lines (default: 10)", quantity("s"))


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
