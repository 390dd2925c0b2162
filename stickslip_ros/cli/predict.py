# SPDX-License-Identifier: Apache-2.0
"""Closed forms: ``stickslip predict``, the step and its amplitude; ``guide``, contact forces."""

from __future__ import annotations

import argparse
import math
from dataclasses import asdict

from stickslip_ros.cli.options import add_drive, option, parameters_from, quantity, report_left_out
from stickslip_ros.cli.outputs import add_outputs, check_outputs, put_out
from stickslip_ros.reporting.terminal import announce_if_slow, format_rows


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
        from stickslip_ros.library.prediction import plot_steps, predict

        found = predict(p, step=args.step)
    report_left_out("predict", found.left_out)
    title = f"Predicted step of {found.amplitude:.5g} V"
    put_out(args, asdict(found), found.report, title, draw=lambda axes: plot_steps(p, found, axes))
    return 0


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

    check_outputs(args)
    given = {name: getattr(args, name) for name in "abce"}
    geometry = Geometry(**{name: length for name, length in given.items() if length is not None})
    forces = forces_by_preload(geometry, args.mass, math.radians(args.inclination), args.preload)
    ratio = preload_ratio(forces, args.preload)
    named = {name.upper(): force for name, force in asdict(forces).items()}
    rows = [(name, f"{1e3 * force:8.1f} mN") for name, force in named.items()]
    rows += [("sum", f"{forces.total:8.3f} N"), ("preload", f"{args.preload:8.3f} N")]
    rows += [("ratio", f"{ratio:8.2f}")]
    content = {"forces": named, "sum": forces.total, "ratio": ratio}
    put_out(args, content, lambda: format_rows(rows, 7), "Contact forces of a guided runner")
    return 0
