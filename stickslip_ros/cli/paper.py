# SPDX-License-Identifier: Apache-2.0
"""``stickslip paper``: simulates every figure and table of the paper, and compares."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from stickslip_ros.cli.options import check_outputs, option, progress_bar
from stickslip_ros.reporting.tables import Cell, write_table

if TYPE_CHECKING:
    from stickslip_ros.paper.report import Outcome

_HEADING = ("claim", "quantity", "unit", "simulated", "joint set", "paper", "verdict")


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the subcommand."""
    parser.epilog = (
        "The page index.html compares the simulation with the paper, with verdicts that follow "
        "from the numbers; beside it stand the pictures and the data behind them as CSV. Takes "
        "about a minute. Exit code 1 if a claim could not be computed."
    )
    text = "folder to write; one of an earlier run is replaced (default: paper)"
    option(parser, "--out", "DIR", text, Path, default=Path("paper"))
    option(parser, "--table", "FILE.csv|FILE.tex", "write all numbers, SI units", Path)


def run(args: argparse.Namespace) -> int:
    """Run the subcommand; return the exit code."""
    from stickslip_ros.compiled import report_compilation
    from stickslip_ros.library.sweep_plan import threads
    from stickslip_ros.paper import CLAIMS, PAGE, refuse_foreign, report
    from stickslip_ros.parameters import Parameters
    from stickslip_ros.traces import run_steps

    refuse_foreign(args.out)
    check_outputs(args)
    with report_compilation():
        run_steps(Parameters(), 1)
    with (
        threads(os.cpu_count() or 1) as (executor, _),
        progress_bar(len(CLAIMS), "claims") as bar,
    ):

        def show(outcome: Outcome) -> None:
            bar.write(f"{outcome.claim.name:<10} {outcome.claim.title}: {outcome.verdicts}")
            sys.stdout.flush()  # a pipe, too, sees each claim when it is computed
            bar.update()

        bar.write(f"{len(CLAIMS)} claims; all take about a minute")
        sys.stdout.flush()
        outcomes = report(args.out, CLAIMS, executor, show)
    if args.table:
        write_table(args.table, _HEADING, _rows(outcomes))
    print(f"report: {args.out / PAGE}")
    failed = [outcome for outcome in outcomes if outcome.fault]
    for outcome in failed:
        print(
            f"stickslip paper: {outcome.claim.name} could not be computed: {outcome.fault}",
            file=sys.stderr,
        )
    return 1 if failed else 0


def _rows(outcomes: Sequence[Outcome]) -> list[list[Cell]]:
    """Return a row for each number; one that nothing in the paper judges has no verdict."""
    return [
        [
            outcome.claim.name, check.what, check.unit, check.value, check.joint, check.paper,
            ("holds" if check.holds else "does not hold") if check.judged else "",
        ]
        for outcome in outcomes
        if outcome.result
        for check in outcome.result.checks
    ]  # fmt: skip
