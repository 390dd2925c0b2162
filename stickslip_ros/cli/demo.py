# SPDX-License-Identifier: Apache-2.0
"""``stickslip demo``: runs the example of that name."""

from __future__ import annotations

import argparse
from importlib.util import find_spec
from pathlib import Path

from stickslip_ros.cli.options import option
from stickslip_ros.errors import UsageError
from stickslip_ros.shared_files import example, shared


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the subcommand."""
    option(parser, "--out", "DIR", "(default: demo)", Path, default=Path("demo"))
    text = "(default: config/table1_typical.yaml)"
    option(parser, "--config", "FILE.yaml", text, Path)


def run(args: argparse.Namespace) -> int:
    """Run the subcommand; return the exit code."""
    if find_spec("rclpy") is None:
        raise UsageError("needs ROS 2: source it or use `make demo`")
    example("demo").run(args.out, args.config or shared("config/table1_typical.yaml"))
    return 0
