# SPDX-License-Identifier: Apache-2.0
"""``stickslip sweep``: metrics over one or two varied parameters."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from stickslip_ros.base.errors import INTERRUPTED, UsageError
from stickslip_ros.cli.options import (
    add_cluster,
    add_parameters,
    option,
    parameters_from,
    progress_bar,
    repeated,
    report_left_out,
)
from stickslip_ros.cli.outputs import add_outputs, check_outputs, put_out, wants_files
from stickslip_ros.simulation.sweep_metrics import METRICS

#: A point runs this many steps at most.
_MOST_STEPS = 100_000


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
    option(
        parser,
        "--jobs",
        "N",
        "number of threads, or of local processes (default: one per processor)",
        int,
    )
    add_cluster(parser)
    add_outputs(parser, "a line over one parameter, a map over two", "the points")


def run(args: argparse.Namespace) -> int:
    """Run the subcommand; return the exit code."""
    if args.out and args.out.suffix.lower() != ".csv":
        raise UsageError(f"--out is {args.out}; it writes FILE.csv, and --plot writes a picture")
    check_outputs(args, args.out)
    if args.jobs is not None and args.jobs < 1:
        raise UsageError(f"--jobs is {args.jobs}; it has to be 1 or more")
    if abs(args.steps or 0) > _MOST_STEPS:
        raise UsageError(f"--steps is {args.steps}; it has to be at most {_MOST_STEPS} for a point")
    import numpy as np

    from stickslip_ros.base.compiled import report_compilation
    from stickslip_ros.base.files import write_text
    from stickslip_ros.simulation.parallel import cluster, threads
    from stickslip_ros.simulation.sweep_plan import Sweep, SweepAxis
    from stickslip_ros.simulation.sweep_result import compute

    plan = Sweep(
        parameters_from(args),
        tuple(SweepAxis.parse(text) for text in args.vary),
        tuple(args.metric or ["step_size"]),
        args.steps,
    )
    plan.refuse_if_impossible()
    _refuse_foreign(args.out)
    report_left_out("sweep", plan.left_out)
    with cluster(args.cluster, args.jobs) if args.cluster else threads(args.jobs) as executor:
        with report_compilation():
            plan.evaluate(0, 1)  # so that no thread has to compile
        with progress_bar(plan.points, "computing points") as bar:
            found = compute(plan, executor, bar.update)
    if args.out:
        write_text(args.out, found.csv_file())
    if found.done < plan.points:
        kept = f" are in {args.out}" if args.out else " were done; --out FILE.csv keeps them"
        print(f"stickslip sweep: interrupted; {found.done} points{kept}", file=sys.stderr)
        return INTERRUPTED
    heading, columns = found.table()
    shown = found.report if args.out or wants_files(args) else found.csv
    put_out(
        args, found.as_json(), shown, "Sweep", (heading, np.transpose(columns).tolist()),
        picture=found.picture,
    )  # fmt: skip
    if not args.json and (complaint := found.complaint()):
        print(f"stickslip sweep: {complaint}", file=sys.stderr)
    return 0


def _refuse_foreign(path: Path | None) -> None:
    """Raise UsageError for a file that would be written over and is no table of a sweep."""
    from stickslip_ros.base.opening import open_regular
    from stickslip_ros.simulation.sweep_result import TITLE

    if path and path.exists():
        with open_regular(path) as file:
            first = file.read(len(TITLE))
        if first and first != TITLE.encode():
            raise UsageError(
                f"{path} exists and is not the table of a sweep: name another --out FILE.csv, or "
                "delete it"
            )
