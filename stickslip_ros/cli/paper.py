# SPDX-License-Identifier: Apache-2.0
"""``stickslip paper``: simulates every figure and table of the paper, and compares."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from stickslip_ros.cli.options import check_outputs, flag, option, progress_bar
from stickslip_ros.errors import UsageError
from stickslip_ros.reporting.tables import Cell, write_table
from stickslip_ros.reporting.terminal import announce_if_slow

if TYPE_CHECKING:
    from stickslip_ros.paper import Claim
    from stickslip_ros.paper.report import ClaimOutcome

_HEADING = ("claim", "quantity", "unit", "simulated", "joint set", "paper", "verdict")


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the subcommand."""
    parser.epilog = (
        "The page index.html compares the simulation with the paper, with verdicts that follow "
        "from the numbers; beside it stand the pictures and the data behind them as CSV. Takes "
        "about a minute. Exit code 1 if a claim could not be computed."
    )
    text = "figures, tables and claims to simulate, such as fig09 (default: all)"
    option(parser, "items", "ITEM", text, nargs="*")
    text = "folder to write; one of an earlier run is replaced (default: paper)"
    option(parser, "--out", "DIR", text, Path, default=Path("paper"))
    option(parser, "--table", "FILE.csv|FILE.tex", "write all numbers, SI units", Path)
    text = "write the picture of one ITEM, and no folder"
    option(parser, "--plot", "FILE.svg|pdf|png", text, Path)
    flag(parser, "--show", "open that picture")


def run(args: argparse.Namespace) -> int:
    """Run the subcommand; return the exit code."""
    with announce_if_slow("loading the claims", in_pipes=True):
        from stickslip_ros.compiled import report_compilation
        from stickslip_ros.library.sweep_plan import threads
        from stickslip_ros.paper import CLAIMS, PAGE, refuse_foreign, report
        from stickslip_ros.parameters import Parameters
        from stickslip_ros.traces import run_steps

    check_outputs(args)
    claims = _chosen(CLAIMS, args.items)
    if not args.plot:
        refuse_foreign(args.out)
    with report_compilation():
        run_steps(Parameters(), 1)
    if args.plot:
        return _write_plot(args.plot, claims)
    with (
        threads(os.cpu_count() or 1) as executor,
        progress_bar(len(claims), "computing claims") as bar,
    ):

        def say(line: str) -> None:
            bar.write(line)
            sys.stdout.flush()  # a pipe, too, sees each claim when it is computed

        def show(outcome: ClaimOutcome) -> None:
            say(f"{outcome.claim.name:<10} {outcome.claim.title}: {outcome.verdicts}")
            bar.update()

        if not args.items:
            say(f"{len(claims)} claims; all take about a minute")
        outcomes = report(args.out, claims, executor, show)
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


def _chosen(claims: Sequence[Claim], names: Sequence[str]) -> Sequence[Claim]:
    """Return the claims of these names, all without names. Raises UsageError."""
    known = {claim.name: claim for claim in claims}
    for name in names:
        if name not in known:
            raise UsageError(f"there is no ITEM {name!r}; there are {', '.join(known)}")
    return [known[name] for name in dict.fromkeys(names)] or claims


def _write_plot(path: Path, claims: Sequence[Claim]) -> int:
    """Write the picture of the only claim. Raises UsageError."""
    from stickslip_ros.paper.report import draw_result
    from stickslip_ros.reporting.picture import save_picture

    if len(claims) != 1:
        raise UsageError("--plot writes the picture of one ITEM: name it, such as fig09")
    with announce_if_slow(f"simulating {claims[0].name}", in_pipes=True):
        result = claims[0].compute()
    if result.draw is None:
        raise UsageError(f"{claims[0].name} has no picture; --table writes its numbers")
    save_picture(path, draw_result(result))
    return 0


def _rows(outcomes: Sequence[ClaimOutcome]) -> list[list[Cell]]:
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
