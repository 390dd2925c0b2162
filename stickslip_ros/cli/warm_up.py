# SPDX-License-Identifier: Apache-2.0
"""``stickslip warm-up``: everything compiled ahead, for images and caches of CI."""

from __future__ import annotations

import argparse
import time


def arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the cache in the help; there are no options."""
    parser.epilog = (
        "NUMBA_CACHE_DIR chooses where the compiled code is kept. What is kept holds for "
        "this version of the package and for processors like this one."
    )


def run(args: argparse.Namespace) -> int:
    """Run the subcommand; return the exit code."""
    from stickslip_ros.library.compile_ahead import warm_up

    begin = time.monotonic()
    warm_up()
    print(f"ready after {time.monotonic() - begin:.1f} s")
    return 0
