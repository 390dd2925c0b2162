# SPDX-License-Identifier: Apache-2.0
"""``stickslip identify-actuator``: from a recording to the actuator's hysteresis and creep."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from stickslip_ros.base.errors import UsageError
from stickslip_ros.base.files import write_text
from stickslip_ros.base.shared_files import sample_file
from stickslip_ros.cli.measurement_options import add_reading_options, reading_of
from stickslip_ros.cli.options import add_parameters, option, parameters_from, yaml_lines
from stickslip_ros.cli.outputs import add_outputs, check_outputs, put_out
from stickslip_ros.physics.parameters import Value

_MOST_OPERATORS = 100


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the subcommand."""
    parser.epilog = "The printed gain belongs to max_voltage: set the max_voltage of your drive."
    text = "voltage and deflection over time, one loop or more (default units: V, m)"
    option(parser, "loop", "RECORDING", text, Path)
    text = "file to write, for hysteresis_file"
    option(parser, "--out", "FILE.yaml", text, Path, required=True)
    option(parser, "--operators", "N", "number of play operators (default: 16)", int, default=16)
    add_reading_options(parser, "voltage,deflection")
    add_parameters(parser)
    add_outputs(parser, "the loop, measured and fitted")


def run(args: argparse.Namespace) -> int:
    """Run the subcommand; return the exit code."""
    if not 1 <= args.operators <= _MOST_OPERATORS:
        raise UsageError(
            f"--operators is {args.operators}; it has to be 1 or more, at most {_MOST_OPERATORS}"
        )
    check_outputs(args, args.out)
    from stickslip_ros.measurement.actuator_identification import identify_hysteresis
    from stickslip_ros.measurement.reading import read_loop
    from stickslip_ros.physics.model.actuator import hysteresis_text

    known = parameters_from(args).actuator
    full = known.max_voltage
    seen = read_loop(sample_file(args.loop), reading_of(args))
    for note in seen.notes:
        print(f"{args.loop.name}: {note}", file=sys.stderr)
    found = identify_hysteresis(
        seen.volts, seen.deflection, args.operators, seen.times, known.creep_start
    )
    remark = (
        f"identified from {args.loop.name}: largest error {100 * found.error:.2f} % of full scale\n"
        "elastic and weights in m/V, thresholds in V"
    )
    write_text(args.out, hysteresis_text(found.actuator, remark))
    wanted: dict[str, Value] = {
        "actuator": "hysteresis",
        "hysteresis_file": str(args.out),
        "gain": found.actuator.stroke(full) / full,
        "max_voltage": full,
    }
    if found.creep is not None:
        wanted |= {"creep": found.creep, "creep_start": known.creep_start}
    names = ("width", "error", "rms_error", "span", "loops", "drift", "creep")
    of_actuator = ("elastic", "thresholds", "weights")
    content = {name: getattr(found, name) for name in names}
    content |= {name: getattr(found.actuator, name) for name in of_actuator}
    put_out(
        args, {**content, "parameters": wanted},
        lambda: f"{found.report()}\n\n{yaml_lines(wanted)}",
        f"Actuator of {args.loop.name}", draw=found.plot,
    )  # fmt: skip
    return 0
