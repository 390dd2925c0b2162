# SPDX-License-Identifier: Apache-2.0
"""``stickslip sweep``: metrics over one or two varied parameters."""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from stickslip_ros.cli.options import (
    add_parameters,
    flag,
    option,
    parameters_from,
    progress_bar,
    repeated,
    report_left_out,
)
from stickslip_ros.cli.outputs import add_outputs, check_outputs, put_out, wants_files
from stickslip_ros.errors import INTERRUPTED, UsageError
from stickslip_ros.simulation.left_out import left_out
from stickslip_ros.simulation.sweep_metrics import METRICS

if TYPE_CHECKING:
    from stickslip_ros.simulation.sweep_output import SweepSummary, SweepTable
    from stickslip_ros.simulation.sweep_plan import Sweep

#: A point runs this many steps at most.
_MOST_STEPS = 100_000
#: Values that fit into memory; more go to a table, row by row.
_MOST_KEPT = 10_000_000


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the subcommand."""
    parser.epilog = f"Metrics: {', '.join(METRICS)}."
    text = "such as preload=0.1:6:60; give it twice for a map; log spaces by equal factors"
    repeated(parser, "--vary", "NAME=START:STOP:COUNT[:log]", text, required=True)
    repeated(parser, "--metric", "NAME", "may be repeated (default: step_size)")
    add_parameters(parser)
    text = "steps per point, the sign is the direction (default: enough to settle)"
    option(parser, "--steps", "N", text, int)
    option(parser, "--out", "FILE.csv", "table (default: prints the points)", Path)
    option(parser, "--jobs", "N", "number of threads (default: one per processor)", int)
    flag(parser, "--resume", "continue an unfinished FILE.csv")
    add_outputs(parser, "a line over one parameter, a map over two", "the points")


def run(args: argparse.Namespace) -> int:
    """Run the subcommand; return the exit code."""
    if args.out and args.out.suffix.lower() != ".csv":
        raise UsageError(f"--out is {args.out}; it writes FILE.csv, and --plot writes a picture")
    if args.resume and not args.out:
        raise UsageError("--resume needs --out FILE.csv, the file to continue")
    check_outputs(args)
    if args.jobs is not None and args.jobs < 1:
        raise UsageError(f"--jobs is {args.jobs}; it has to be 1 or more")
    if abs(args.steps or 0) > _MOST_STEPS:
        raise UsageError(f"--steps is {args.steps}; it has to be at most {_MOST_STEPS} for a point")
    import numpy as np

    from stickslip_ros.simulation.sweep_output import SweepSummary, SweepTable
    from stickslip_ros.simulation.sweep_plan import GridAxis, Sweep
    from stickslip_ros.simulation.sweep_result import SweepResult

    sweep = Sweep(
        parameters_from(args),
        tuple(GridAxis.parse(text) for text in args.vary),
        tuple(args.metric or ["step_size"]),
        args.steps,
    )
    sweep.refuse_if_impossible()
    report_left_out("sweep", left_out(sweep.base))
    keep = wants_files(args) or args.json
    if keep and sweep.points * len(sweep.metrics) > _MOST_KEPT:
        raise UsageError(
            f"{sweep.points} points are too many for --json, a table, page or picture, which take "
            f"{_MOST_KEPT} values; lower COUNT or write --out FILE.csv alone"
        )
    found = SweepSummary(sweep, keep=keep)
    table = SweepTable(sweep, args.out, args.resume) if args.out else None
    try:
        whole = _carry_out(args, sweep, table, found)
    finally:
        if table:
            table.close()
    values = found.kept
    if values is not None:
        from stickslip_ros.reporting.picture import save_picture
        from stickslip_ros.simulation.sweep_plot import picture_of_sweep
    if not whole:
        if args.plot and values is not None:
            save_picture(args.plot, picture_of_sweep(sweep, values))
        _print_resume_hint(table, found, args.plot)
        return INTERRUPTED
    if values is not None:
        kept = SweepResult.of(sweep, values)
        heading, columns = kept.table()
        put_out(
            args, kept.as_json(), found.summary, "Sweep",
            (heading, np.transpose(columns).tolist()),
            picture=lambda: picture_of_sweep(sweep, values),
        )  # fmt: skip
    elif args.out:
        print(found.summary())
    if found.empty and not args.json:
        print(f"stickslip sweep: {found.complaint()}", file=sys.stderr)
    return 0


def _carry_out(
    args: argparse.Namespace, sweep: Sweep, table: SweepTable | None, found: SweepSummary
) -> bool:
    """Run the sweep; return False if Ctrl-C ended it."""
    from stickslip_ros.compiled import report_compilation
    from stickslip_ros.simulation.sweep_output import heading, write_rows
    from stickslip_ros.simulation.sweep_plan import results, threads

    workers = args.jobs or os.cpu_count() or 1
    to_stdout = not (args.out or args.json or wants_files(args))
    try:
        if table:
            for first, values in table.rows():
                found.add(first, values)
        if to_stdout:
            print(",".join(heading(sweep)))
        with report_compilation():
            sweep.evaluate(0, 1)  # so that no thread has to compile
        with progress_bar(sweep.points, "computing points") as bar, threads(workers) as pool:
            bar.update(found.done)
            for first, values in results(sweep, pool, workers, found.done):
                if table:
                    table.append(first, values)
                if to_stdout:
                    write_rows(sweep, first, values, sys.stdout)
                found.add(first, values)
                bar.update(len(values))
    except KeyboardInterrupt:
        return False
    return True


def _print_resume_hint(table: SweepTable | None, found: SweepSummary, picture: Path | None) -> None:
    done = found.done
    if table:
        # Ctrl-C may have come between writing and counting.
        done = table.points_in_file()
        cure = f"are in {table.path}; the same command with --resume continues"
    elif picture:
        cure = f"are in {picture}; with --out FILE.csv the sweep could be resumed"
    else:
        cure = "were done; with --out FILE.csv the sweep could be resumed"
    print(f"stickslip sweep: interrupted; {done} points {cure}", file=sys.stderr)
