# SPDX-License-Identifier: Apache-2.0
"""``stickslip demo``: runs the example of that name."""

from __future__ import annotations

import argparse
from importlib.util import find_spec
from pathlib import Path

from stickslip_ros.cli.options import UsageError
from stickslip_ros.shared_files import example, shared


def add_parser(subparsers: argparse._SubParsersAction) -> None:  # type: ignore[type-arg]
    """Add the subcommand."""
    parser = subparsers.add_parser("demo")
    parser.add_argument(
        "--out", type=Path, default=Path("demo"), metavar="DIR", help="(default: demo)"
    )
    parser.add_argument(
        "--config", type=Path, metavar="FILE.yaml", help="(default: config/table1_typical.yaml)"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run the subcommand; return the exit code."""
    if find_spec("rclpy") is None:
        raise UsageError("needs ROS 2: source it or use `make demo`")
    example("demo").run(args.out, args.config or shared("config/table1_typical.yaml"))
    return 0
