# SPDX-License-Identifier: Apache-2.0
"""``stickslip analyse``: the runs of steps in a measurement, and what they say."""

from __future__ import annotations

import argparse
import json
import math
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from stickslip_ros.cli.measurement_options import (
    add_measurement_options,
    measurement_of,
    steps_in,
)
from stickslip_ros.cli.options import (
    UsageError,
    add_outputs,
    as_typed,
    check_outputs,
    option,
    quantity,
    switch,
)
from stickslip_ros.reporting import plain
from stickslip_ros.reporting.tables import write_table

if TYPE_CHECKING:
    from stickslip_ros.traces import StepAnalysis
    from stickslip_ros.traces.motion import Motion
    from stickslip_ros.traces.runs import FoundSteps, Run

#: Part by which a run may be off the frequency that was given, as clocks and short runs are.
_AS_TOLD = 0.02
#: Columns of the table by the names of the JSON.
_COLUMNS = {
    "start": "start (s)", "end": "end (s)", "frequency": "frequency (Hz)",
    "direction": "direction", "steps": "steps", "step_size": "step size (m)",
    "step_size_error": "standard error of the step size (m)", "from_cycle": "from cycle",
    "to_cycle": "to cycle", "explained": "explained",
    "determined": "determined", "scatter": "scatter (m)",
    "backstep": "backstep (m)",
    "backstep_error": "standard error of the backstep (m)",
    "ringing_frequency": "ringing frequency (Hz)", "damping_ratio": "damping ratio",
    "mean_speed": "mean speed (m/s)",
}  # fmt: skip


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the subcommand."""
    text = "a trace, table or bag: every file that compare can read"
    option(parser, "trace", "MEASUREMENT", text, Path)
    switch(parser, "--runner-only", "ignore the actuator, as if it was not measured")
    option(parser, "--frequency", "HZ", "drive frequency (default: found)", quantity("Hz"))
    option(parser, "--start", "S", "time of the first cycle (default: found)", quantity("s"))
    text = "0-amplitude, measured separately, for Eq. 9"
    option(parser, "--zero-amplitude", "M", text, quantity("m"))
    add_outputs(parser, "the runs, step by step", "the runs with plots", "the runs")
    add_measurement_options(parser)


def run(args: argparse.Namespace) -> int:
    """Run the subcommand; return the exit code."""
    if args.frequency is not None and not 0.0 < args.frequency < math.inf:
        raise UsageError(f"--frequency is {args.frequency:g} Hz; it has to be above 0")
    if args.zero_amplitude is not None and not 0.0 <= args.zero_amplitude < math.inf:
        raise UsageError(f"--zero-amplitude is {args.zero_amplitude:g} m; it has to be 0 or more")
    from stickslip_ros.pages.texts import analysis_text
    from stickslip_ros.traces import TraceError

    check_outputs(args)
    try:
        motion, seen, found = _analysed(measurement_of(args, args.trace), args)
        _write(args, motion, seen)
    except TraceError as error:
        raise UsageError(f"{args.trace}: {error}") from None
    if args.json:
        runs = seen.runs
        content = {
            **asdict(found),
            "steps": sum(run.steps for run in runs) if runs else len(found.slips),
            "runs": [run.as_json() for run in runs],
            "disturbances": seen.disturbances.as_json(),
        }
        print(json.dumps(plain(content), allow_nan=False))
    else:
        print(analysis_text(seen.runs, found))
    alone = motion.u is None or args.runner_only  # an actuator that was measured tells the cycles
    return 1 if alone and not (_as_told(args, seen) and _all_determined(args, seen)) else 0


def _all_determined(args: argparse.Namespace, seen: FoundSteps) -> bool:
    """Return whether the record holds what is said of its runs; say why where it does not."""
    for run in seen.runs:
        if run.doubts:
            print(
                f"{args.trace}: the {run.steps} steps from {run.start:.6g} s to {run.end:.6g} s "
                f"are not determined: {'; '.join(run.doubts)}",
                file=sys.stderr,
            )
    return all(run.determined for run in seen.runs)


def _as_told(args: argparse.Namespace, seen: FoundSteps) -> bool:
    """Return whether steps are seen at the frequency that was given; say so if they are not."""
    if args.frequency is None or args.start is not None:
        return True
    if _at(args.frequency, seen):
        return True
    others = ", ".join(f"{run.frequency:.6g} Hz" for run in seen.runs) or "none"
    print(
        f"{args.trace}: no run of steps is seen at the {args.frequency:g} Hz given (seen: "
        f"{others}); what is printed takes the frequency as it was given",
        file=sys.stderr,
    )
    return False


def _at(frequency: float, seen: FoundSteps) -> list[Run]:
    """Return the runs that are seen at a frequency (Hz)."""
    return [run for run in seen.runs if abs(run.frequency / frequency - 1.0) < _AS_TOLD]


def _write(args: argparse.Namespace, motion: Motion, seen: FoundSteps) -> None:
    if not (args.plot or args.report or args.table):
        return
    if not seen.runs:
        from stickslip_ros.traces import TraceError

        raise TraceError("no run of steps is seen that a picture or a table could show")
    if args.table:
        found = [run.as_json() for run in seen.runs]
        rows = [[k, *(run[key] for key in _COLUMNS)] for k, run in enumerate(found, 1)]
        write_table(args.table, ["run", *_COLUMNS.values()], rows)
    if args.plot:
        from stickslip_ros.pages.measured import figures
        from stickslip_ros.reporting.picture import write_picture

        plots = [plot.figure for plot in figures(motion, seen.runs)]
        write_picture(args.plot, plots, motion.source)
    if args.report:
        from stickslip_ros.pages.measured import write_page

        write_page(args.report, motion, seen, as_typed())


def _analysed(motion: Motion, args: argparse.Namespace) -> tuple[Motion, FoundSteps, StepAnalysis]:
    """Return motion, what is seen in it, and the analysis of the longest run. TraceError."""
    from stickslip_ros.traces import analyse_steps
    from stickslip_ros.traces.runs import main_run

    u = None if args.runner_only else motion.u
    period = None if args.frequency is None else 1.0 / args.frequency
    motion, seen = steps_in(args, motion, period)
    if u is None and args.start is None and args.zero_amplitude is None:
        runs = seen.runs if period is None else _at(args.frequency, seen)
        if runs or period is None:
            return motion, seen, main_run(runs).analysis
    found = analyse_steps(
        motion.t, motion.x, u,
        frequency=args.frequency, start=args.start, zero_amplitude=args.zero_amplitude,
    )  # fmt: skip
    return motion, seen, found
