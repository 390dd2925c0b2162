# SPDX-License-Identifier: Apache-2.0
"""``stickslip compare``: how far a run and a measurement are apart."""

from __future__ import annotations

import argparse
import json
import math
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from stickslip_ros.cli.measurement_options import (
    add_measurement_options,
    measurement_of,
    steps_in,
)
from stickslip_ros.cli.options import UsageError, add_assignments, parameters_of
from stickslip_ros.cli.registered import LIMITS
from stickslip_ros.files import check_folder
from stickslip_ros.parameters import PARAMETERS, Parameters, Value
from stickslip_ros.reporting import plain, shown
from stickslip_ros.reporting.tables import check_table, write_table
from stickslip_ros.reporting.terminal import coloured
from stickslip_ros.version import __version__

if TYPE_CHECKING:
    from stickslip_ros.measurement import Comparison, Judgement
    from stickslip_ros.traces.motion import Motion
    from stickslip_ros.traces.runs import Run


def add_parser(subparsers: argparse._SubParsersAction) -> None:  # type: ignore[type-arg]
    """Add the subcommand."""
    parser = subparsers.add_parser(
        "compare",
        epilog="Exit code 1 if a limit is exceeded. docs/compare.md explains tables and metrics.",
    )
    parser.add_argument(
        "simulation",
        type=Path,
        metavar="RUN",
        help="the run: a parameter file (.yaml) to simulate, a trace (.csv) or a bag",
    )
    parser.add_argument("measurement", type=Path, metavar="MEASUREMENT", help="a table or a bag")
    parser.add_argument("--report", type=Path, metavar="FILE.html", help="write a page with plots")
    parser.add_argument(
        "--table", type=Path, metavar="FILE.csv|FILE.tex", help="write the metrics, SI units"
    )
    parser.add_argument("--png", type=Path, metavar="FILE.png", help="write a picture")
    parser.add_argument("--json", action="store_true", help="print one JSON object, SI units")
    simulation = parser.add_argument_group("a run that is simulated")
    add_assignments(simulation)
    simulation.add_argument(
        "--steps",
        type=int,
        metavar="N",
        help="steps to simulate, the sign is the direction (default: as measured)",
    )
    add_measurement_options(parser)
    fitting = parser.add_argument_group("bringing both together")
    yes_no: Any = argparse.BooleanOptionalAction
    fitting.add_argument("--fit-offset", action=yes_no, default=True, help="fit the clock offset")
    fitting.add_argument("--fit-drift", action=yes_no, default=False, help="fit the clock drift")
    fitting.add_argument(
        "--fit-level", action=yes_no, default=True, help="fit the zero of the sensor"
    )
    fitting.add_argument(
        "--fit-gain", action=yes_no, default=False, help="fit the gain of the sensor"
    )
    fitting.add_argument(
        "--filter", type=float, metavar="HZ", help="low-pass filter both, without delay"
    )
    limits = parser.add_argument_group("limits, SI units")
    for name, (unit, what) in LIMITS.items():
        limits.add_argument(f"--max-{name}", type=float, metavar=unit.upper() or "X", help=what)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run the subcommand; return the exit code."""
    from stickslip_ros.measurement import ComparisonError, Fits, compare, judge
    from stickslip_ros.measurement.reading import MeasurementError

    allowed = _allowed(args)
    if args.table:
        check_table(args.table)
    for path in (args.report, args.png):
        if path:
            check_folder(path)
    try:
        simulation, measurement, p, version, runs = _motions(args)
        found = compare(
            simulation,
            measurement,
            Fits(args.fit_offset, args.fit_drift, args.fit_level, args.fit_gain),
            args.filter,
            runs,
        )
        judgements = judge(found, allowed)
        _write(args, found, judgements, p, version)
    except (ComparisonError, MeasurementError) as error:
        raise UsageError(str(error)) from None
    print(_json(found, judgements, p, version) if args.json else _table(found, judgements))
    exceeded = [judgement for judgement in judgements if not judgement.kept]
    for judgement in exceeded:
        who = coloured("stickslip compare:", "bold red", sys.stderr)
        print(f"{who} {judgement}", file=sys.stderr)
    return 1 if exceeded else 0


def _allowed(args: argparse.Namespace) -> dict[str, float]:
    given = {name: getattr(args, f"max_{name.replace('-', '_')}") for name in LIMITS}
    for name, value in given.items():
        if value is not None and not 0.0 <= value < math.inf:
            raise UsageError(f"--max-{name} is {value:g}; it has to be 0 or more")
    return {name: value for name, value in given.items() if value is not None}


class _Motions(NamedTuple):
    """Run and measurement; parameters and version of the run, runs measured, where known."""

    run: Motion
    measurement: Motion
    parameters: dict[str, Value] | None
    version: str | None
    measured: list[Run] | None


def _motions(args: argparse.Namespace) -> _Motions:
    from stickslip_ros.compiled import telling_when_compiling
    from stickslip_ros.measurement.load_motion import is_parameter_file, load_motion

    if not is_parameter_file(args.simulation) and (args.assignments or args.steps is not None):
        raise UsageError(
            f"--set and --steps change a simulated run only; {args.simulation} is used as it is"
        )
    if is_parameter_file(args.measurement) and not is_parameter_file(args.simulation):
        raise UsageError(
            f"{args.measurement} is a parameter file; give the run first, then the measurement"
        )
    if is_parameter_file(args.simulation):
        p = parameters_of(argparse.Namespace(config=args.simulation, assignments=args.assignments))
        measurement = measurement_of(args, args.measurement)
        measurement, seen = steps_in(args, measurement, 1.0 / p.drive.frequency)
        with telling_when_compiling():
            simulation = _simulated(p, args, measurement, seen.runs)
        return _Motions(simulation, measurement, p.flat(), __version__, seen.runs)
    run = load_motion(args.simulation, joint=args.joint)
    measurement = measurement_of(args, args.measurement, run.origin_ns)
    if measurement.u is not None and not (args.fit_position_drift or args.remove_hum):
        return _Motions(run.motion, measurement, *run[2:], None)
    measurement, seen = steps_in(args, measurement, None)
    runs = seen.runs if measurement.u is None else None
    return _Motions(run.motion, measurement, *run[2:], runs)


def _simulated(
    p: Parameters, args: argparse.Namespace, measurement: Motion, runs: list[Run]
) -> Motion:
    """Simulate what the measurement shows, its rests included, or the steps asked for."""
    from stickslip_ros.measurement.load_motion import simulate_as_measured, simulate_motion
    from stickslip_ros.measurement.run_pairs import measured_runs

    name = args.simulation.name
    if args.steps is not None:
        return simulate_motion(p, args.steps, name)
    if not runs:
        found = measured_runs(measurement)
        if not found:
            raise UsageError(
                f"no steps are found in {measurement.source}; give --steps, how many to simulate"
            )
        steps = found[0].steps
        return simulate_motion(p, steps.direction * len(steps.slips), name)
    return simulate_as_measured(p, measurement, runs, name)


def _write(
    args: argparse.Namespace,
    found: Comparison,
    judgements: Sequence[Judgement],
    p: dict[str, Value] | None,
    version: str | None,
) -> None:
    if args.report:
        from stickslip_ros.measurement.page import About, write_page
        from stickslip_ros.reporting.page import versions

        about = About(
            command=shlex.join(["stickslip", *sys.argv[1:]]),
            parameters=p or {},
            units={row.name: row.unit for row in PARAMETERS.values()},
            versions={"stickslip_ros, run": version or "not known", **versions()},
        )
        write_page(args.report, found, judgements, about)
    if args.table:
        heading = ("metric", "unit", "run", "measured", "difference", "tolerance", "verdict")
        rows = [
            (m.name, m.unit, m.run, m.measured, m.difference, m.tolerance, _verdict(m.differs))
            for m in found.metrics
        ]
        write_table(args.table, heading, rows)
    if args.png:
        from stickslip_ros.measurement.picture import plot_comparison

        plot_comparison(args.png, found)


def _verdict(differs: bool | None) -> str:
    return "not determined" if differs is None else "differs" if differs else "agrees"


def _json(
    found: Comparison,
    judgements: Sequence[Judgement],
    p: dict[str, Value] | None,
    version: str | None,
) -> str:
    limits = [
        {
            "what": judgement.what,
            "found": plain(judgement.found),
            "allowed": judgement.allowed,
            "kept": judgement.kept,
        }
        for judgement in judgements
    ]
    content = {
        "run": found.run.source,
        "measurement": found.measurement.source,
        **found.as_json(),
        "limits": limits,
        "passed": all(judgement.kept for judgement in judgements),
        "parameters": p,
        "version": version,
    }
    return json.dumps(content, allow_nan=False)


def _table(found: Comparison, judgements: Sequence[Judgement]) -> str:
    place = found.alignment
    lines = [
        f"{'RMSE':<18} {shown(found.rmse, 'm')}, {100.0 * found.normalised:.3g} % of the range",
        f"{'  of the steps':<18} {shown(found.step_rmse, 'm')}, adding up from step to step",
        f"{'  of the shape':<18} {shown(found.shape_rmse, 'm')}, within the cycles",
        f"{'largest':<18} {shown(found.largest, 'm')} at {shown(found.largest_at, 's', 6)}",
        f"{'sensor noise':<18} {shown(found.noise, 'm')}",
    ]
    if found.fits.offset:
        error = shown(place.offset_error, "s", 2)
        lines.append(f"{'clock offset':<18} {shown(place.offset, 's', 7)} ± {error}")
    if found.fits.drift:
        lines.append(f"{'clock drift':<18} {1e6 * place.drift:.4g} ppm")
    if found.fits.gain:
        lines.append(f"{'sensor gain':<18} {place.gain:.6g}")
    lines.append(
        f"\n{'metric':<18} {'run':>12} {'measured':>12} {'difference':>12} {'tolerance':>12}"
    )
    for metric in found.metrics:
        if metric.differs is None:
            lines.append(f"{metric.name:<18} {metric.why_missing or 'not determined'}")
            continue
        values = [shown(value, metric.unit, 5) for value in (metric.run, metric.measured)]
        values += [shown(value, metric.unit, 3) for value in (metric.difference, metric.tolerance)]
        cells = " ".join(f"{value:>12}" for value in values)
        lines.append(f"{metric.name:<18} {cells}  {_coloured(metric.differs)}")
    lines += ["", *found.notes()]
    for judgement in judgements:
        good = judgement.kept
        word = coloured("kept", "green") if good else coloured("EXCEEDED", "bold red")
        lines.append(f"{word}: {judgement}")
    return "\n".join(lines)


def _coloured(differs: bool) -> str:
    return coloured("DIFFERS", "bold red") if differs else coloured("agrees", "green")
