# SPDX-License-Identifier: Apache-2.0
"""``stickslip warm-up``: everything compiled ahead, for images and caches of CI."""

from __future__ import annotations

import argparse
import time


def add_parser(subparsers: argparse._SubParsersAction) -> None:  # type: ignore[type-arg]
    """Add the subcommand."""
    parser = subparsers.add_parser(
        "warm-up",
        epilog="NUMBA_CACHE_DIR chooses where the compiled code is kept. What is kept holds for "
        "this version of the package and for processors like this one.",
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run the subcommand; return the exit code."""
    from stickslip_ros.library.warm_up import warm_up

    begin = time.monotonic()
    warm_up()
    print(f"ready after {time.monotonic() - begin:.1f} s")
    return 0
