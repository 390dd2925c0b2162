# SPDX-License-Identifier: Apache-2.0
"""Entry point of the command ``stickslip``."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence

from stickslip_ros import __version__
from stickslip_ros.bag import BagError
from stickslip_ros.cli import (
    analyse,
    bag,
    bench,
    compare,
    demo,
    elongate,
    guide,
    identify_actuator,
    paper,
    shape,
    simulate,
    sweep,
)
from stickslip_ros.cli.options import UsageError
from stickslip_ros.parameters import ParameterError

_BAD_USE, _INTERRUPTED = 2, 130

#: In the order of the help
COMMANDS = (
    simulate,
    sweep,
    paper,
    analyse,
    compare,
    shape,
    elongate,
    identify_actuator,
    guide,
    bag,
    demo,
    bench,
)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return 0, 1 for a finding, 2 for bad use."""
    try:
        try:
            return _run(argv)
        finally:
            print(end="", flush=True)  # what is left, as long as somebody handles its failure
    except BrokenPipeError:  # the reader of our output went away, as `head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0


def _run(argv: Sequence[str] | None) -> int:
    parser = argparse.ArgumentParser(
        prog="stickslip", description="Simulator of piezo stick-slip micro-drives (CEIM)."
    )
    parser.add_argument("--version", action="version", version=__version__)
    subparsers = parser.add_subparsers(required=True, metavar="COMMAND", dest="command")
    for command in COMMANDS:
        command.add_parser(subparsers)
    args = parser.parse_args(argv)
    try:
        return int(args.run(args))
    except (BagError, ParameterError, UsageError) as error:
        print(f"stickslip {args.command}: {error}", file=sys.stderr)
        return _BAD_USE
    except KeyboardInterrupt:
        print(f"stickslip {args.command}: interrupted", file=sys.stderr)
        return _INTERRUPTED


if __name__ == "__main__":
    sys.exit(main())
