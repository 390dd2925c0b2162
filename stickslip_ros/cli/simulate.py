# SPDX-License-Identifier: Apache-2.0
"""``stickslip simulate``: a run of steps from rest."""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from stickslip_ros.base.errors import UsageError
from stickslip_ros.cli.options import (
    add_drive,
    flag,
    option,
    parameters_from,
    progress_bar,
    quantity,
)
from stickslip_ros.cli.outputs import add_outputs, check_outputs, put_out
from stickslip_ros.physics.laws import LAWS
from stickslip_ros.physics.parameters import ParameterError
from stickslip_ros.physics.waveforms import WAVEFORMS

if TYPE_CHECKING:
    from stickslip_ros.simulation.run import SimulatedRun

#: Endings of files that hold text, as a trace does.
_TEXT = ("", ".csv", ".txt", ".dat", ".tsv")


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the subcommand."""
    parser.epilog = (
        f"Friction laws (--set model=NAME): {', '.join(LAWS)}. "
        f"Waveforms (--set waveform=NAME): {', '.join(WAVEFORMS)}."
    )
    option(parser, "--steps", "N", "the sign is the direction (default: 30)", int, default=30)
    add_drive(parser)
    add_outputs(parser, "runner and actuator over time", "the steps")
    text = "write runner, actuator and contact over time"
    option(parser, "--trace", "FILE.csv", text, Path)
    text = "write the trace at even times instead, so many a second, each value exact"
    option(parser, "--trace-rate", "HZ", text, quantity("Hz"))
    text = "write into --trace what the simulated sensor reads instead: time and position"
    flag(parser, "--sensor", text)


def run(args: argparse.Namespace) -> int:
    """Run the subcommand; return the exit code."""
    if args.trace_rate is not None and (args.sensor or not args.trace):
        raise UsageError("--trace-rate is for a --trace without --sensor, which has a sensor_rate")
    if args.trace and args.trace.suffix.lower() not in _TEXT:
        raise UsageError(f"--trace is {args.trace}; it writes text: end its name in .csv")
    if args.sensor and not args.trace:
        raise UsageError("--sensor says what --trace writes; give --trace FILE.csv, too")
    from stickslip_ros.base.compiled import report_compilation
    from stickslip_ros.simulation.readings import save_readings
    from stickslip_ros.simulation.run import SimulatedRun, check_steps
    from stickslip_ros.simulation.steps import run_steps
    from stickslip_ros.simulation.trace import save_csv

    check_steps(
        args.steps,
        bool((args.trace and not args.trace_rate) or args.plot or args.report),
        "--steps",
    )
    check_outputs(args)
    p = parameters_from(args)
    with report_compilation(), progress_bar(abs(args.steps), "simulating steps") as bar:
        result = SimulatedRun(p, run_steps(p, args.steps, bar.update), args.steps)
    unknown = ""
    try:
        zero = result.zero_amplitude
    except ParameterError as error:  # the run has been possible, so a drive of the search is not
        zero, unknown = math.nan, str(error)
    if args.sensor:
        save_readings(result.readings, args.trace)
    elif args.trace:
        even = args.trace_rate is not None
        save_csv(result.trace_at(args.trace_rate) if even else result.trace, args.trace)
    rows = list(zip(*result.table.values(), strict=True))
    put_out(
        args, _content(result, zero), result.report, result.title,
        (list(result.table), rows), draw=result.plot,
    )  # fmt: skip
    if unknown:
        print(f"stickslip simulate: no 0-amplitude: {unknown}", file=sys.stderr)
    return 0


def _content(run: SimulatedRun, zero: float | None) -> dict[str, object]:
    return {
        "steps": run.count,
        "position": run.position,
        "step_size": run.step_size,
        "backstep": run.backstep,
        "mean_speed": run.mean_speed,
        "zero_amplitude": zero,
        "growth": run.growth,
        "parameters": run.parameters.flat(),
    }
