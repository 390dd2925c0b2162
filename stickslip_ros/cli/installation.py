# SPDX-License-Identifier: Apache-2.0
"""What follows an installation: ``stickslip demo`` and ``warm-up``."""

from __future__ import annotations

import argparse
import time
from importlib.util import find_spec
from pathlib import Path

from stickslip_ros.base.errors import UsageError
from stickslip_ros.base.shared_files import example, shared
from stickslip_ros.cli.options import option


def demo_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    option(parser, "--out", "DIR", "(default: demo)", Path, default=Path("demo"))
    text = "(default: config/table1_typical.yaml)"
    option(parser, "--config", "FILE.yaml", text, Path)


def run_demo(args: argparse.Namespace) -> int:
    """Run the example of that name."""
    if find_spec("rclpy") is None:
        raise UsageError("needs ROS 2: source it or use `make demo`")
    example("demo").run(args.out, args.config or shared("config/table1_typical.yaml"))
    return 0


def warm_up_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the cache in the help; there are no options."""
    parser.epilog = (
        "NUMBA_CACHE_DIR chooses where the compiled code is kept. What is kept holds for "
        "this version of the package and for processors like this one."
    )


def run_warm_up(args: argparse.Namespace) -> int:
    """Compile everything ahead, for images and caches of CI."""
    from stickslip_ros.simulation.compile_ahead import warm_up

    begin = time.monotonic()
    warm_up()
    print(f"ready after {time.monotonic() - begin:.1f} s")
    return 0
