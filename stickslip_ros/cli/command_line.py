# SPDX-License-Identifier: Apache-2.0
"""The subcommands of ``stickslip`` and what becomes of a command line."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Sequence
from typing import NoReturn

from stickslip_ros import __version__
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
from stickslip_ros.errors import StickslipError
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


class _Parser(argparse.ArgumentParser):
    """A parser whose errors are one line, and that takes -1e-3 for a number."""

    def __init__(self, *args: object, **kwargs: object) -> None:
        super().__init__(*args, **kwargs)  # type: ignore[arg-type]
        self._negative_number_matcher = re.compile(r"-(\d+\.?\d*|\.\d+)(e[-+]?\d+)?$|-inf$", re.I)

    def error(self, message: str) -> NoReturn:
        """Say what is wrong and where the options stand, and end."""
        self.exit(_BAD_USE, f"{self.prog}: {message}; see {self.prog} --help\n")


def run(argv: Sequence[str] | None) -> int:
    """Run a command line (without the program's name); return its exit code."""
    parser = _Parser(
        prog="stickslip", description="Simulator of piezo stick-slip micro-drives (CEIM)."
    )
    parser.add_argument("--version", action="version", version=__version__)
    subparsers = parser.add_subparsers(required=True, metavar="COMMAND", dest="command")
    for command in COMMANDS:
        command.add_parser(subparsers)
    args = parser.parse_args(argv)
    name = " ".join(["stickslip", args.command, *([args.action] if "action" in args else [])])
    try:
        return int(args.run(args))
    except (StickslipError, ParameterError, UsageError) as error:
        print(f"{name}: {error}", file=sys.stderr)
        return _BAD_USE
    except KeyboardInterrupt:
        print(f"{name}: interrupted", file=sys.stderr)
        return _INTERRUPTED
