# SPDX-License-Identifier: Apache-2.0
"""``stickslip compare``: the differences of a run and a measurement."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stickslip_ros.base.errors import UsageError
from stickslip_ros.base.reporting import format_si
from stickslip_ros.base.reporting.terminal import style_text
from stickslip_ros.base.shared_files import config_file
from stickslip_ros.cli.measurement_options import (
    add_drive_known,
    add_measurement_options,
    drive_of,
    measurement_of,
    say_doubts,
    steps_in,
)
from stickslip_ros.cli.options import add_assignments, option, parameters_from, quantity
from stickslip_ros.cli.outputs import add_outputs, check_outputs, put_out
from stickslip_ros.measurement.metric import LIMITS
from stickslip_ros.version import __version__

if TYPE_CHECKING:
    from stickslip_ros.measurement.bags.load_motion import LoadedMotion
    from stickslip_ros.measurement.comparison import Comparison
    from stickslip_ros.measurement.metric import ComparisonMetric
    from stickslip_ros.measurement.steps.run import Run
    from stickslip_ros.simulation.motion import Motion


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the subcommand."""
    parser.epilog = "Exit code 1 if a limit is exceeded. docs/compare.md explains the metrics."
    text = "the run: a parameter file (.yaml) to simulate, a trace (.csv) or a bag"
    option(parser, "simulation", "RUN", text, Path)
    option(parser, "measurement", "MEASUREMENT", "a table or a bag", Path, nargs="?")
    text = "the parameter file of the drive, in place of RUN"
    option(parser, "--config", "FILE.yaml", text, Path)
    add_outputs(parser, "run, measurement and difference", "the metrics")
    simulation = parser.add_argument_group("a run that is simulated")
    add_assignments(simulation)
    add_drive_known(parser, config=False)
    add_measurement_options(parser)
    fitting = parser.add_argument_group("bringing both together")
    yes_no: Any = argparse.BooleanOptionalAction
    for name, usual, text in (
        ("offset", True, "fit the clock offset"), ("drift", False, "fit the clock drift"),
        ("level", True, "fit the zero of the sensor"), ("gain", False, "fit its gain"),
    ):  # fmt: skip
        fitting.add_argument(f"--fit-{name}", action=yes_no, default=usual, help=text)
    limits = parser.add_argument_group("limits, SI units")
    for name, limit in LIMITS.items():
        metavar = limit.unit.upper() or "X"
        option(limits, f"--max-{name}", metavar, limit.what, quantity(limit.unit))


def run(args: argparse.Namespace) -> int:
    """Run the subcommand; return the exit code."""
    from stickslip_ros.cli.pages.compared import comparison_page
    from stickslip_ros.measurement.comparison import compare_motions
    from stickslip_ros.measurement.motion_pair import Fits

    given = {name: getattr(args, f"max_{name.replace('-', '_')}") for name in LIMITS}
    allowed = {name: value for name, value in given.items() if value is not None}
    for name, value in allowed.items():
        if not 0.0 <= value < math.inf:
            raise UsageError(f"--max-{name} is {value:g}; it has to be 0 or more")
    if args.config and args.measurement:
        raise UsageError(f"--config {args.config} is the run already: leave out {args.simulation}")
    if args.config:
        args.simulation, args.measurement, args.config = args.config, args.simulation, None
    if not args.measurement:
        raise UsageError(f"{args.simulation} with what? give RUN and MEASUREMENT, or --config")
    check_outputs(args)
    simulation, measurement, runs, period = _motions(args)
    fits = Fits(args.fit_offset, args.fit_drift, args.fit_level, args.fit_gain)
    found = compare_motions(simulation.motion, measurement, fits, runs, period)
    say_doubts(measurement.source, runs or [])
    judgements = found.judge(allowed)
    title = f"{found.run.source} and {found.measurement.source}: RMSE {format_si(found.rmse, 'm')}"
    shown = found, judgements, simulation
    put_out(
        args, _content(*shown), lambda: _text(found, judgements), title,
        found.table, page=lambda: comparison_page(*shown),
    )  # fmt: skip
    exceeded = [judgement for judgement in judgements if not judgement.kept]
    for judgement in exceeded:
        who = style_text("stickslip compare:", "bold red", sys.stderr)
        print(f"{who} {judgement.judgement}", file=sys.stderr)
    return 1 if exceeded else 0


def _text(found: Comparison, judgements: Sequence[ComparisonMetric]) -> str:
    words = style_text("EXCEEDED", "bold red"), style_text("kept", "green")
    lines = [f"{words[one.kept]}: {one.judgement}" for one in judgements]
    return "\n".join([found.report(), *lines])


def _motions(
    args: argparse.Namespace,
) -> tuple[LoadedMotion, Motion, list[Run] | None, float | None]:
    """Return the run, the measurement, the runs of steps in it where they were looked for, and the
    period (s) of the drive of a run that is simulated.
    """
    from stickslip_ros.base.compiled import report_compilation
    from stickslip_ros.measurement.as_measured import simulate_as_measured, simulate_motion
    from stickslip_ros.measurement.bags.load_motion import (
        LoadedMotion,
        is_parameter_file,
        load_motion,
    )
    from stickslip_ros.simulation.sampling import PlannedRun

    if not args.simulation.suffix:  # a bag, or one of our parameter files by its name
        args.simulation = config_file(args.simulation)
    simulated = is_parameter_file(args.simulation)
    if not simulated and args.assignments:
        raise UsageError(f"--set changes a simulated run only; {args.simulation} is used as it is")
    if not simulated and is_parameter_file(args.measurement):
        raise UsageError(
            f"{args.measurement} is a parameter file; give the run first, then the measurement"
        )
    if simulated:
        p = parameters_from(
            argparse.Namespace(config=args.simulation, assignments=args.assignments)
        )
        measurement, recorded = measurement_of(args, args.measurement, finer=True)
        period, name = 1.0 / p.drive.frequency, args.simulation.name
        drive = drive_of(args, measurement, recorded).or_at(p.drive.frequency)
        measurement, seen = steps_in(args, measurement, drive)
        with report_compilation():
            simulation = (
                simulate_as_measured(p, measurement, seen.runs, name)
                if seen.runs or not drive.steps
                else simulate_motion(
                    p, [PlannedRun(0.0, drive.steps[0])], name, period, 2.0 * period
                )
            )
        loaded = LoadedMotion(simulation, None, p.flat(), __version__)
        return loaded, measurement, seen.runs, period
    run = load_motion(args.simulation, joint=args.joint)
    if run.parameters is not None:
        from stickslip_ros.measurement.bags.finer import finest_motion  # it needs the solver

        run = run._replace(motion=finest_motion(args.simulation, run))
    measurement, recorded = measurement_of(args, args.measurement, run.origin_ns, finer=True)
    drive = drive_of(args, measurement, recorded)
    measurement, seen = steps_in(args, measurement, drive)
    return run, measurement, seen.runs, None


def _content(
    found: Comparison, judgements: Sequence[ComparisonMetric], simulation: LoadedMotion
) -> dict[str, Any]:
    names = ("what", "found", "allowed", "kept")
    return {
        "run": found.run.source,
        "measurement": found.measurement.source,
        **found.as_json(),
        "limits": [{name: getattr(one, name) for name in names} for one in judgements],
        "passed": all(judgement.kept for judgement in judgements),
        "parameters": simulation.parameters,
        "version": simulation.version,
    }
