# SPDX-License-Identifier: Apache-2.0
"""Closed forms: ``stickslip predict``, the step and its amplitude; ``guide``, contact forces."""

from __future__ import annotations

import argparse
import math
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


def predict_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.epilog = (
        "step = stroke - a0, at low frequency and steep slip; an axis outside of its range "
        "is refused. docs/prediction.md has the equation and its error."
    )
    text = "find the amplitude that makes this step"
    option(parser, "--step", "M", text, quantity("m"))
    add_drive(parser)
    add_outputs(parser, "the step over the amplitude, with its error")


def run_predict(args: argparse.Namespace) -> int:
    """Predict the step of an amplitude, or the amplitude for a step."""
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


def guide_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.epilog = "Use the ratio printed last with other subcommands: --set preload_ratio=..."
    option(parser, "--mass", "KG", "(default: 3g)", quantity("kg"), default=3e-3)
    option(parser, "--preload", "N", "(default: 0.2N)", quantity("N"), default=0.2)
    text = (
        "the paper's alpha, from the vertical to the axis: 90 (default) is level; the parameter "
        "`inclination` is different: rad above the horizontal"
    )
    option(parser, "--inclination", "DEG", text, quantity("deg"), default=90.0)
    for name in "abce":
        text = "length of Fig. 16 (default: that of the paper's guide)"
        option(parser, f"--{name}", "M", text, quantity("m"))
    add_outputs(parser)


def run_guide(args: argparse.Namespace) -> int:
    """Print the six contact forces of a guided runner."""
    from stickslip_ros.model.guide import Geometry, forces_by_preload, preload_ratio

    given = {name: getattr(args, name) for name in "abce"}
    geometry = Geometry(**{name: length for name, length in given.items() if length is not None})
    forces = forces_by_preload(geometry, args.mass, math.radians(args.inclination), args.preload)
    ratio = preload_ratio(forces, args.preload)
    named = {name.upper(): force for name, force in asdict(forces).items()}
    rows = [(name, f"{1e3 * force:8.1f} mN") for name, force in named.items()]
    rows += [("sum", f"{forces.total:8.3f} N"), ("preload", f"{args.preload:8.3f} N")]
    rows += [("ratio", f"{ratio:8.2f}")]
    content = {"forces": named, "sum": forces.total, "ratio": ratio}
    print_result(args, content, lambda: "\n".join(f"{name:<8}{value}" for name, value in rows))
    return 0
