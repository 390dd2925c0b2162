# SPDX-License-Identifier: Apache-2.0
"""``stickslip paper``: every figure and table of the paper, simulated, beside what it says."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from stickslip_ros.cli.options import UsageError, progress_bar
from stickslip_ros.compiled import telling_when_compiling
from stickslip_ros.parameters import Parameters
from stickslip_ros.studies.sweep import threads
from stickslip_ros.traces import run_steps

if TYPE_CHECKING:
    from stickslip_ros.paper import Entry


def add_parser(subparsers: argparse._SubParsersAction) -> None:  # type: ignore[type-arg]
    """Add the subcommand."""
    parser = subparsers.add_parser(
        "paper",
        description=(
            "Simulates the figures, tables and findings of the paper and writes a folder: a page "
            "(index.html) that sets ours beside what the paper says, with verdicts that follow "
            "from the numbers, pictures, and the data behind each as CSV. Takes under a minute. "
            "Exit code 1 if an item could not be computed."
        ),
    )
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("paper"),
        metavar="DIR",
        help="folder to write; one of an earlier run is replaced (default: paper)",
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run the subcommand; return the exit code."""
    from stickslip_ros.paper import ITEMS, PAGE, FolderError, refuse_if_not_ours, report

    try:
        refuse_if_not_ours(args.out)
        with telling_when_compiling():
            run_steps(Parameters(), 1)
        with (
            threads(os.cpu_count() or 1) as (executor, _),
            progress_bar(len(ITEMS), "items") as bar,
        ):
            entries = report(args.out, ITEMS, executor, bar.update)
    except FolderError as error:
        raise UsageError(str(error)) from None
    print(_table(entries))
    print(f"report: {args.out / PAGE}")
    failed = [entry for entry in entries if entry.fault]
    for entry in failed:
        print(
            f"stickslip paper: {entry.item.name} could not be computed: {entry.fault}",
            file=sys.stderr,
        )
    return 1 if failed else 0


def _table(entries: Sequence[Entry]) -> str:
    return "\n".join(f"{e.item.name:<8} {e.verdict:<22} {e.item.title}" for e in entries)
