# SPDX-License-Identifier: Apache-2.0
"""``make paper``: simulates every figure and table of the paper, and compares."""

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from stickslip_ros.base.compiled import report_compilation
from stickslip_ros.base.errors import UsageError
from stickslip_ros.base.reporting import to_json
from stickslip_ros.cli.command_line import Parser, finish
from stickslip_ros.cli.options import flag, option, progress_bar
from stickslip_ros.physics.parameters import Parameters
from stickslip_ros.simulation.parallel import threads
from stickslip_ros.simulation.steps import run_steps
from validation.paper.claim import Claim, Result
from validation.paper.report import CLAIMS, PAGE, ClaimOutcome, refuse_foreign, report


def run(args: argparse.Namespace) -> int:
    """Compute the claims and write their folder; return the exit code."""
    claims = _chosen(args.items)
    refuse_foreign(args.out)
    with report_compilation():
        run_steps(Parameters(), 1)
    with threads() as executor, progress_bar(len(claims), "computing claims") as bar:

        def show(outcome: ClaimOutcome) -> None:
            if not args.json:
                bar.write(f"{outcome.claim.name:<10} {outcome.claim.title}: {outcome.verdicts}")
                sys.stdout.flush()  # a pipe, too, sees each claim when it is computed
            bar.update()

        outcomes = report(args.out, claims, executor, show)
    if args.json:
        rows = [row for one in outcomes if one.result for row in _rows(one.claim, one.result)]
        print(json.dumps(to_json({"numbers": rows}), allow_nan=False))
    else:
        print(f"report: {args.out / PAGE}")
    failed = [outcome for outcome in outcomes if outcome.fault]
    for one in failed:
        print(f"paper: {one.claim.name} could not be computed: {one.fault}", file=sys.stderr)
    return 1 if failed else 0


def _chosen(names: Sequence[str]) -> Sequence[Claim]:
    """Return the claims of these names, all without names. Raises UsageError."""
    known = {claim.name: claim for claim in CLAIMS}
    for name in names:
        if name not in known:
            raise UsageError(f"there is no ITEM {name!r}; there are {', '.join(known)}")
    return [known[name] for name in dict.fromkeys(names)] or CLAIMS


def _rows(claim: Claim, result: Result) -> list[dict[str, object]]:
    """Return a row for each number; one that nothing in the paper judges has no verdict."""
    return [
        {
            "claim": claim.name, "quantity": check.what, "unit": check.unit,
            "simulated": check.value, "joint set": check.joint, "paper": check.paper,
            "verdict": ("holds" if check.holds else "does not hold") if check.judged else "",
        }
        for check in result.checks
    ]  # fmt: skip


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return its exit code."""
    parser = Parser(
        prog="make paper",
        description="Simulates every figure and table of the paper. The page index.html compares "
        "the simulation with the paper, with verdicts that follow from the numbers; beside it "
        "stand the pictures and the data behind them as CSV. Takes about a minute.",
        epilog="Exit code 1 if a claim could not be computed.",
    )
    text = "figures, tables and claims to simulate, such as fig09 (default: all)"
    option(parser, "items", "ITEM", text, nargs="*")
    text = "folder to write; one of an earlier run is replaced (default: paper)"
    option(parser, "--out", "DIR", text, Path, default=Path("paper"))
    flag(parser, "--json", "print all numbers as one JSON object, SI units")
    parser.set_defaults(run=run)
    return finish("paper", parser.parse_args(argv))


if __name__ == "__main__":
    sys.exit(main())
