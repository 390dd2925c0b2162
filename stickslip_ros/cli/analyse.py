# SPDX-License-Identifier: Apache-2.0
"""``stickslip analyse``: the runs of steps in a measurement, and what they say."""

from __future__ import annotations

import argparse
import json
import math
import shlex
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from stickslip_ros.cli.measurement_options import (
    add_measurement_options,
    measurement_of,
    steps_in,
)
from stickslip_ros.cli.options import UsageError
from stickslip_ros.files import check_folder
from stickslip_ros.reporting import plain
from stickslip_ros.reporting.tables import check_table, write_table
from stickslip_ros.reporting.terminal import lines_of, micro

if TYPE_CHECKING:
    from stickslip_ros.traces import StepAnalysis
    from stickslip_ros.traces.motion import Motion
    from stickslip_ros.traces.runs import FoundSteps, Run

#: Columns of the table by the names of the JSON.
_COLUMNS = {
    "start": "start (s)", "end": "end (s)", "frequency": "frequency (Hz)",
    "direction": "direction", "steps": "steps", "step_size": "step size (m)",
    "step_size_error": "standard error of the step size (m)", "from_cycle": "from cycle",
    "to_cycle": "to cycle", "explained": "explained", "scatter": "scatter (m)",
    "backstep": "backstep (m)",
    "backstep_error": "standard error of the backstep (m)",
    "ringing_frequency": "ringing frequency (Hz)", "damping_ratio": "damping ratio",
    "mean_speed": "mean speed (m/s)",
}  # fmt: skip


def add_parser(subparsers: argparse._SubParsersAction) -> None:  # type: ignore[type-arg]
    """Add the subcommand."""
    parser = subparsers.add_parser("analyse")
    parser.add_argument(
        "trace",
        type=Path,
        metavar="MEASUREMENT",
        help="a trace, table or bag: every file that compare can read",
    )
    parser.add_argument(
        "--runner-only", action="store_true", help="ignore the actuator, as if it was not measured"
    )
    parser.add_argument(
        "--frequency", type=float, metavar="HZ", help="drive frequency (default: found)"
    )
    parser.add_argument(
        "--start", type=float, metavar="S", help="time of the first cycle (default: found)"
    )
    parser.add_argument(
        "--zero-amplitude",
        type=float,
        metavar="M",
        help="0-amplitude, measured separately, for Eq. 9",
    )
    parser.add_argument(
        "--plot", type=Path, metavar="FILE", help="write a picture: .png, .svg or .pdf"
    )
    parser.add_argument("--report", type=Path, metavar="FILE.html", help="write a page with plots")
    parser.add_argument(
        "--table", type=Path, metavar="FILE.csv|FILE.tex", help="write the runs, SI units"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object, SI units")
    add_measurement_options(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run the subcommand; return the exit code."""
    if args.frequency is not None and not 0.0 < args.frequency < math.inf:
        raise UsageError(f"--frequency is {args.frequency:g} Hz; it has to be above 0")
    if args.zero_amplitude is not None and not 0.0 <= args.zero_amplitude < math.inf:
        raise UsageError(f"--zero-amplitude is {args.zero_amplitude:g} m; it has to be 0 or more")
    from stickslip_ros.measurement.reading import MeasurementError
    from stickslip_ros.traces import TraceError

    _check_files(args)
    try:
        motion, seen, found = _analysed(measurement_of(args, args.trace), args)
        _write(args, motion, seen)
    except TraceError as error:
        raise UsageError(f"{args.trace}: {error}") from None
    except MeasurementError as error:
        raise UsageError(str(error)) from None
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
        print("\n".join([*map(_line, seen.runs), _table(found)]))
    return 0


def _check_files(args: argparse.Namespace) -> None:
    if args.plot:
        from stickslip_ros.measurement.picture import PICTURES

        if args.plot.suffix.lower() not in PICTURES:
            known = ", ".join(PICTURES)
            raise UsageError(f"--plot is {args.plot}; its name has to end with {known}")
    if args.table:
        check_table(args.table)
    for path in (args.plot, args.report):
        if path:
            check_folder(path)


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
        from stickslip_ros.measurement.picture import plot_runs

        plot_runs(args.plot, motion, seen.runs)
    if args.report:
        from stickslip_ros.measurement.analysis_page import write_analysis
        from stickslip_ros.reporting.page import versions

        write_analysis(
            args.report, motion, seen, shlex.join(["stickslip", *sys.argv[1:]]), versions()
        )


def _analysed(motion: Motion, args: argparse.Namespace) -> tuple[Motion, FoundSteps, StepAnalysis]:
    """Return motion, what is seen in it, and the analysis of the longest run. TraceError."""
    from stickslip_ros.traces import analyse_steps
    from stickslip_ros.traces.runs import main_run

    u = None if args.runner_only else motion.u
    period = None if args.frequency is None else 1.0 / args.frequency
    motion, seen = steps_in(args, motion, period)
    if u is None and args.start is None and period is None and args.zero_amplitude is None:
        return motion, seen, main_run(seen.runs).analysis
    found = analyse_steps(
        motion.t,
        motion.x,
        u,
        frequency=args.frequency,
        start=args.start,
        zero_amplitude=args.zero_amplitude,
    )
    return motion, seen, found


def _line(run: Run) -> str:
    way = "forward" if run.direction > 0 else "backward"
    return (
        f"{run.steps} steps {way} at {run.frequency:.6g} Hz, {run.start:.9g} s to {run.end:.9g} s: "
        f"{1e9 * run.step_size:.3f} nm a step, standard error {1e9 * run.step_size_error:.3f} nm, "
        f"from cycles {run.first_cycle + 1} to {run.steps}"
    )


def _table(found: StepAnalysis) -> str:
    balance = found.balance

    def nano(length: float) -> str:
        return "not measurable" if math.isnan(length) else f"{1e9 * length:.3f} nm"

    rings = not math.isnan(found.ringing_frequency)
    rows = [
        ("cycles", f"{len(found.starts)} of {found.period:g} s, from {found.starts[0]:g} s"),
        ("step size", nano(found.step_size)),
        ("backstep", nano(found.backstep)),
        ("ringing", f"{found.ringing_frequency:.1f} Hz" if rings else "none visible"),
        (
            "decay",
            f"{found.decay:.1f} 1/s, {found.damping_ratio:.4f} of critical" if rings else "-",
        ),
        ("mean speed", f"{1e6 * found.mean_speed:.3f} {micro()}m/s"),
    ]
    if math.isnan(balance.excitation):
        rows.append(("Eq. 9", "needs the deflection of the actuator, which is not known"))
        return lines_of(rows)
    rows += [
        ("excitation", nano(balance.excitation)),
        ("regained", nano(balance.regained)),
        ("left (Eq. 9)", nano(balance.left)),
        ("0-amplitude", nano(balance.zero_amplitude)),
        ("remainder", nano(balance.remainder)),
    ]
    return lines_of(rows)
