# SPDX-License-Identifier: Apache-2.0
"""``stickslip analyse``: the runs of steps in a measurement, with steps, backsteps and ringing."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stickslip_ros.base.errors import StickslipError, UsageError
from stickslip_ros.base.reporting.terminal import nanometres
from stickslip_ros.cli.measurement_options import (
    add_drive_known,
    add_measurement_options,
    drive_of,
    measurement_of,
    say_doubts,
    steps_in,
)
from stickslip_ros.cli.options import add_cluster, flag, option, progress_bar, quantity
from stickslip_ros.cli.outputs import add_outputs, check_outputs, put_out, wants_files

if TYPE_CHECKING:
    from stickslip_ros.base.reporting.page import ResultPage
    from stickslip_ros.measurement.steps.analysis import Findings
    from stickslip_ros.measurement.steps.run import Run
    from stickslip_ros.simulation.motion import Motion

#: Columns of the table by the names of the JSON.
_COLUMNS = {
    "start": "start (s)", "end": "end (s)", "frequency": "frequency (Hz)",
    "direction": "direction", "steps": "steps", "step_size": "step size (m)",
    "step_size_error": "standard error of the step size (m)", "from_cycle": "from cycle",
    "to_cycle": "to cycle",
    "determined": "determined", "scatter": "scatter (m)",
    "backstep": "backstep (m)",
    "backstep_error": "standard error of the backstep (m)",
    "ringing_frequency": "ringing frequency (Hz)", "damping_ratio": "damping ratio",
    "mean_speed": "mean speed (m/s)",
}  # fmt: skip


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the subcommand."""
    text = "a trace, table or bag: every file that compare can read; several make one table"
    option(parser, "traces", "MEASUREMENT", text, Path, nargs="+")
    flag(parser, "--runner-only", "ignore the actuator, as if it was not measured")
    text = "0-amplitude, measured separately, for Eq. 9"
    option(parser, "--zero-amplitude", "M", text, quantity("m"))
    add_outputs(parser, "the runs, step by step", "the runs")
    add_cluster(parser)
    add_drive_known(parser)
    add_measurement_options(parser)


def run(args: argparse.Namespace) -> int:
    """Run the subcommand; return the exit code."""
    if args.zero_amplitude is not None and not 0.0 <= args.zero_amplitude < math.inf:
        raise UsageError(f"--zero-amplitude is {args.zero_amplitude:g} m; it has to be 0 or more")
    from stickslip_ros.measurement.steps.record import TraceError

    check_outputs(args)
    args.trace = args.traces[0]
    if len(args.traces) > 1 or args.cluster:
        return _run_many(args)
    try:
        motion, seen, found = _analysed(args)
        if wants_files(args) and not seen.runs:
            raise TraceError("no run of steps is seen that a picture or a table could show")
    except TraceError as error:
        raise UsageError(f"{args.trace}: {error}") from None
    content = {
        "of_run": 1 + next(k for k, run in enumerate(seen.runs) if run is found),
        **found.cycles_as_json(),
        "steps": sum(run.steps for run in seen.runs),
        "runs": [run.as_json() for run in seen.runs],
        "disturbances": seen.disturbances.as_json(),
    }
    rows = [[k, *(run[key] for key in _COLUMNS)] for k, run in enumerate(content["runs"], 1)]
    put_out(
        args, content, lambda: analysis_text(seen.runs, found), motion.source,
        (["run", *_COLUMNS.values()], rows), page=lambda: _page(motion, seen),
    )  # fmt: skip
    return 0 if say_doubts(args.trace, seen.runs) else 1


def _run_many(args: argparse.Namespace) -> int:
    """Analyse several measurements, each by itself, into one table; 1 if one cannot be read."""
    if args.plot or args.report:
        raise UsageError(
            f"{len(args.traces)} measurements make one --table or --json; --plot and --report are "
            "for a single one: name it"
        )
    from stickslip_ros.simulation.parallel import cluster, in_order, threads

    shown = {key: value for key, value in vars(args).items() if not callable(value)}
    given = [argparse.Namespace(**{**shown, "trace": path}) for path in args.traces]
    # In threads of one process they would wait for each other.
    workers = cluster(args.cluster) if args.cluster else threads(1)
    rows: list[dict[str, Any]] = []
    with progress_bar(len(given), "analysing measurements") as bar, workers as executor:
        for found in in_order(executor, _rows_of, given):
            rows += found
            bar.update()
    columns = {"file": "file", "run": "run", **_COLUMNS, "reason": "reason"}
    lines = [
        f"{row['file']}: {row['reason']}"
        if row["reason"]
        else f"{row['file']}, run {row['run']}: {row['steps']} steps, "
        f"{nanometres(row['step_size'], row['step_size_error'])}"
        for row in rows
    ]
    table = list(columns.values()), [[row.get(key) for key in columns] for row in rows]
    put_out(args, {"runs": rows}, lambda: "\n".join(lines), "Measurements", table)
    return 1 if any(row["reason"] for row in rows) else 0


def _rows_of(args: argparse.Namespace) -> list[dict[str, Any]]:
    """Return what is found in one measurement, a run each, or the reason why nothing is."""
    try:
        _, seen, _ = _analysed(args)
    except StickslipError as error:
        return [{"file": str(args.trace), "reason": str(error).partition("\n")[0]}]
    return [
        {"file": str(args.trace), "run": k, **run.as_json(), "reason": ""}
        for k, run in enumerate(seen.runs, 1)
    ]


def analysis_text(runs: Sequence[Run], found: Run) -> str:
    """Return a line for each run, and the report of one, which is named if there are more."""
    lines = []
    for run in runs:
        way = "forward" if run.direction > 0 else "backward"
        doubt = "" if run.determined else ", not determined"
        size = nanometres(run.step_size, run.step_size_error)
        lines.append(
            f"{run.steps} steps {way} at {run.frequency:.5g} Hz, {run.span}{doubt}: "
            f"a step is {size}, from cycles {run.first_cycle + 1} to {run.steps}"
        )
    named = [f"of the {found.steps} steps from {found.span}:"] if len(runs) > 1 else []
    return "\n".join([*lines, *named, found.report()])


def _page(motion: Motion, seen: Findings) -> ResultPage:
    from stickslip_ros.cli.pages.measured import measurement_page  # for a page or a picture only

    return measurement_page(motion, seen)


def _analysed(args: argparse.Namespace) -> tuple[Motion, Findings, Run]:
    """Return the motion, the findings in it, and its longest run. Raises TraceError."""
    from stickslip_ros.measurement.steps.run import main_run

    motion, recorded = measurement_of(args, args.trace, finer=True)
    drive = drive_of(args, motion, recorded)
    motion, seen = steps_in(args, motion, drive, args.runner_only)
    if args.zero_amplitude is not None:
        known = [replace(one, zero_amplitude=args.zero_amplitude) for one in seen.runs]
        seen = replace(seen, runs=known)
    return motion, seen, main_run(seen.runs)
