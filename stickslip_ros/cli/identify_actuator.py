# SPDX-License-Identifier: Apache-2.0
"""``stickslip identify-actuator``: from a recording to the actuator's hysteresis and creep."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stickslip_ros.cli.measurement_options import add_reading_options, reading_of
from stickslip_ros.cli.options import (
    add_outputs,
    add_parameters,
    option,
    parameters_from,
    print_result,
    yaml_lines,
)
from stickslip_ros.errors import UsageError
from stickslip_ros.files import write_text
from stickslip_ros.parameters import Value
from stickslip_ros.reporting.terminal import format_rows
from stickslip_ros.shared_files import sample_file

if TYPE_CHECKING:
    from stickslip_ros.measurement.actuator_identification import IdentifiedActuator

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
    add_outputs(parser)


def run(args: argparse.Namespace) -> int:
    """Run the subcommand; return the exit code."""
    if not 1 <= args.operators <= _MOST_OPERATORS:
        raise UsageError(
            f"--operators is {args.operators}; it has to be 1 or more, at most {_MOST_OPERATORS}"
        )
    from stickslip_ros.measurement.actuator_identification import identify_hysteresis
    from stickslip_ros.measurement.reading import read_loop
    from stickslip_ros.model.actuator import hysteresis_text

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
    print_result(args, _content(found, wanted), lambda: f"{_table(found)}\n\n{yaml_lines(wanted)}")
    return 0


def _content(found: IdentifiedActuator, wanted: dict[str, Value]) -> dict[str, Any]:
    names = ("width", "error", "rms_error", "span", "loops", "drift", "creep")
    return {name: getattr(found, name) for name in names} | {
        "elastic": found.actuator.elastic,
        "thresholds": found.actuator.thresholds,
        "weights": found.actuator.weights,
        "parameters": wanted,
    }


def _table(found: IdentifiedActuator) -> str:
    rows = [
        ("loops", str(found.loops)),
        ("stroke", f"{1e9 * found.span:.3f} nm, as measured"),
        ("loop width", f"{100 * found.width:.2f} % of the stroke"),
        ("error left", f"{100 * found.error:.2f} % of the stroke at most"),
        ("", f"{100 * found.rms_error:.2f} % of the stroke, root mean square"),
    ]
    if found.drift is not None:
        rows.append(("drift", f"{1e9 * found.drift:.3g} nm/s, taken out"))
    if found.creep is not None:
        rows.append(("creep", f"{100 * found.creep:.2f} % in a decade of time"))
    return format_rows(rows)
