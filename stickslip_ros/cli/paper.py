# SPDX-License-Identifier: Apache-2.0
"""``stickslip paper``: simulates every figure and table of the paper, and compares."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from stickslip_ros.cli.options import option, progress_bar
from stickslip_ros.cli.outputs import add_outputs, check_outputs, put_out
from stickslip_ros.errors import UsageError
from stickslip_ros.reporting.tables import Cell
from stickslip_ros.reporting.terminal import announce_if_slow

if TYPE_CHECKING:
    from stickslip_ros.paper import Claim, Result
    from stickslip_ros.paper.report import ClaimOutcome

_HEADING = ("claim", "quantity", "unit", "simulated", "joint set", "paper", "verdict")


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the subcommand."""
    parser.epilog = (
        "The page index.html compares the simulation with the paper, with verdicts that follow "
        "from the numbers; beside it stand the pictures and the data behind them as CSV. Takes "
        "about a minute. --plot and --report are for one ITEM, and then no folder is written. Exit "
        "code 1 if a claim could not be computed."
    )
    text = "figures, tables and claims to simulate, such as fig09 (default: all)"
    option(parser, "items", "ITEM", text, nargs="*")
    text = "folder to write; one of an earlier run is replaced (default: paper)"
    option(parser, "--out", "DIR", text, Path, default=Path("paper"))
    add_outputs(parser, "that of one ITEM", "all numbers")


def run(args: argparse.Namespace) -> int:
    """Run the subcommand; return the exit code."""
    with announce_if_slow("loading the claims", in_pipes=True):
        from stickslip_ros.compiled import report_compilation
        from stickslip_ros.motion.steps import run_steps
        from stickslip_ros.paper import CLAIMS, PAGE, refuse_foreign, report
        from stickslip_ros.parameters import Parameters
        from stickslip_ros.simulation.parallel import threads

    check_outputs(args)
    claims = _chosen(CLAIMS, args.items)
    alone = bool(args.plot or args.report)
    if alone and len(claims) != 1:
        raise UsageError("--plot and --report are for one ITEM: name it, such as fig09")
    if not alone:
        refuse_foreign(args.out)
    with report_compilation():
        run_steps(Parameters(), 1)
    if alone:
        return _show_alone(args, claims[0])
    with (
        threads() as executor,
        progress_bar(len(claims), "computing claims") as bar,
    ):

        def say(line: str) -> None:
            if not args.json:
                bar.write(line)
                sys.stdout.flush()  # a pipe, too, sees each claim when it is computed

        def show(outcome: ClaimOutcome) -> None:
            say(f"{outcome.claim.name:<10} {outcome.claim.title}: {outcome.verdicts}")
            bar.update()

        if not args.items:
            say(f"{len(claims)} claims; all take about a minute")
        outcomes = report(args.out, claims, executor, show)
    rows = [row for one in outcomes if one.result for row in _rows(one.claim, one.result)]
    content = {"numbers": [dict(zip(_HEADING, row, strict=True)) for row in rows]}
    put_out(args, content, lambda: f"report: {args.out / PAGE}", table=(_HEADING, rows))
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


def _show_alone(args: argparse.Namespace, claim: Claim) -> int:
    """Write the picture or the page of one claim. Raises UsageError."""
    from stickslip_ros.paper.report import draw_result

    with announce_if_slow(f"simulating {claim.name}", in_pipes=True):
        result = claim.compute()
    if args.plot and result.draw is None:
        raise UsageError(f"{claim.name} has no picture; --table writes its numbers")
    rows = _rows(claim, result)
    content = {"numbers": [dict(zip(_HEADING, row, strict=True)) for row in rows]}
    lines = [f"{check.what}: {check.text}" for check in result.checks]
    put_out(
        args, content, lambda: "\n".join(lines), claim.title, (_HEADING, rows),
        picture=(lambda: draw_result(result)) if result.draw else None,
    )  # fmt: skip
    return 0


def _rows(claim: Claim, result: Result) -> list[list[Cell]]:
    """Return a row for each number; one that nothing in the paper judges has no verdict."""
    return [
        [
            claim.name, check.what, check.unit, check.value, check.joint, check.paper,
            ("holds" if check.holds else "does not hold") if check.judged else "",
        ]
        for check in result.checks
    ]  # fmt: skip
