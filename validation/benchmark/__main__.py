# SPDX-License-Identifier: Apache-2.0
"""``make bench``: speed and error against general solvers, in one run."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from stickslip_ros.base.errors import StickslipError
from stickslip_ros.base.files import check_folder
from stickslip_ros.cli.command_line import Parser, finish
from stickslip_ros.cli.options import progress_bar
from validation import benchmark
from validation.benchmark import METHODS, OURS, PEERS, blocks

CASE_NAMES = [case.name for case in benchmark.CASES]

#: Of a quick run: one slow case, where rest can be skipped, and one fast one, where it cannot.
_QUICK_CASES = ("0.4N-1000Hz", "0.4N-18500Hz")


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    parser = Parser(
        prog="make bench",
        description=(
            "Measures time and error per cycle of this solver and of general ones on the same "
            "cases, restarted at the same kinks. Takes two to three minutes and needs an otherwise "
            "idle machine; --quick takes under a minute. docs/benchmark.md says what is "
            "measured and how. make installs the peers; missing ones are reported."
        ),
    )
    parser.add_argument(
        "--quick", action="store_true", help="two cases, fewer repeats, for a first impression"
    )
    parser.add_argument(
        "--methods",
        nargs="+",
        choices=PEERS,
        metavar="NAME",
        help=f"peers to compare with, from: {' '.join(PEERS)} (default: all)",
    )
    parser.add_argument(
        "--cases",
        nargs="+",
        choices=CASE_NAMES,
        metavar="NAME",
        help=f"cases to measure, from: {' '.join(CASE_NAMES)} (default: all)",
    )
    parser.add_argument(
        "--blocks",
        action="store_true",
        help="measure the blocks of 10 ms in which a node advances its axes, and nothing else",
    )
    parser.add_argument(
        "--beside",
        type=Path,
        metavar="FOLDER",
        help="with --blocks: another checkout of the project, measured in turns with this one",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object, SI units")
    parser.add_argument(
        "--plot",
        type=Path,
        metavar="FILE.png",
        help="draw error against cost, one panel for each case",
    )
    parser.set_defaults(run=run)
    return parser


def run(args: argparse.Namespace) -> int:
    """Measure; return the exit code."""
    if args.beside and not args.blocks:
        raise StickslipError("--beside is for blocks: give --blocks, too")
    if args.blocks:
        with progress_bar(blocks.ROUNDS, "blocks") as bar:
            found = blocks.compare(args.beside, bar.update)
        print(json.dumps(found) if args.json else blocks.table(found))
        return 0
    if args.plot:
        check_folder(args.plot)
    wanted = args.cases or (_QUICK_CASES if args.quick else CASE_NAMES)
    cases = [case for case in benchmark.CASES if case.name in wanted]
    chosen = args.methods or PEERS
    names = [name for name in METHODS if name == OURS or name in chosen]
    effort = benchmark.QUICK if args.quick else benchmark.FULL
    results = []
    with progress_bar(benchmark.work(len(cases), len(names), effort), "bench") as bar:
        methods, missing = benchmark.load(names, bar.update)
        for case in cases:
            result = benchmark.measure(
                case, methods, missing, effort, time.perf_counter, bar.update
            )
            results.append(result)
            if not args.json:
                bar.write(benchmark.table(result) + "\n")
    if args.plot:
        benchmark.plot(args.plot, results)
    print(json.dumps(benchmark.as_json(results)) if args.json else benchmark.summary(results))
    return 0


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return its exit code."""
    return finish("bench", parser().parse_args(argv))


if __name__ == "__main__":
    sys.exit(main())
