# SPDX-License-Identifier: Apache-2.0
"""``stickslip predict``: the step in closed form, and the amplitude for a wanted step."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from typing import TYPE_CHECKING

from stickslip_ros.cli.options import (
    add_drive,
    add_outputs,
    check_outputs,
    option,
    parameters_from,
    print_result,
    quantity,
    report_left_out,
)
from stickslip_ros.reporting import MEASURED, SIMULATED, draw_lines, format_si
from stickslip_ros.reporting.terminal import announce_if_slow, format_rows

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from stickslip_ros.library import Prediction
    from stickslip_ros.parameters import Parameters

#: Amplitudes at which a picture asks for the step.
_POINTS = 80


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the subcommand."""
    parser.epilog = (
        "step = stroke - a0, at low frequency and steep slip; an axis outside of its range "
        "is refused. docs/prediction.md has the equation and its error."
    )
    text = "find the amplitude that makes this step"
    option(parser, "--step", "M", text, quantity("m"))
    add_drive(parser)
    add_outputs(parser, "the step over the amplitude, with its error")


def run(args: argparse.Namespace) -> int:
    """Run the subcommand; return the exit code."""
    p = parameters_from(args)
    check_outputs(args)
    with announce_if_slow("predicting", in_pipes=True):
        from stickslip_ros.library.prediction import predict

        found = predict(p, step=args.step)
    report_left_out("predict", found.left_out)
    if args.plot:
        from stickslip_ros.reporting.picture import draw_picture

        draw_picture(args.plot, lambda axes: _draw(p, found, axes))
    rows = [
        ("amplitude", f"{found.amplitude:.5g} V"),
        ("stroke", format_si(found.stroke, "m", 5)),
        ("a0", format_si(found.zero_offset, "m", 4)),
        ("step", f"{format_si(found.step, 'm', 5)}, within {format_si(found.error, 'm', 2)}"),
    ]
    print_result(args, asdict(found), lambda: format_rows(rows))
    return 0


def _draw(p: Parameters, found: Prediction, axes: Axes) -> None:
    """Draw the steps of all amplitudes that the closed form holds for, and the one asked for."""
    import numpy as np

    from stickslip_ros.library.prediction import steps_over

    volts = np.linspace(0.0, p.actuator.max_voltage, _POINTS + 1)[1:]
    step, error = (1e9 * lengths for lengths in steps_over(p, volts))
    lines = [
        (volts, step, "-", SIMULATED, "prediction"),
        ([found.amplitude], [1e9 * found.step], "o", MEASURED, "asked for"),
    ]
    draw_lines(axes, lines, "amplitude (V)", "step (nm)")
    axes.fill_between(volts, step - error, step + error, color=SIMULATED, alpha=0.2, linewidth=0)
