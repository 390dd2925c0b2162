# SPDX-License-Identifier: Apache-2.0
"""Design of a drive: ``stickslip predict``, the step in closed form; ``shape``, a quiet slip;
``elongate``, the largest step.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stickslip_ros.base.errors import UsageError
from stickslip_ros.base.files import write_text
from stickslip_ros.base.reporting import MEASURED, SIMULATED, draw_lines
from stickslip_ros.base.reporting.terminal import announce_if_slow
from stickslip_ros.cli.options import (
    add_drive,
    add_parameters,
    option,
    parameters_from,
    quantity,
    report_left_out,
    yaml_lines,
)
from stickslip_ros.cli.outputs import PICTURES, add_outputs, check_outputs, put_out
from stickslip_ros.physics.parameters import Parameters, yaml_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from stickslip_ros.simulation.waveform_search import ElongatedStep, ShapedSlip


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
        from stickslip_ros.simulation.prediction import plot_steps, predict

        found = predict(p, step=args.step)
    report_left_out("predict", found.left_out)
    title = f"Predicted step of {found.amplitude:.5g} V"
    put_out(args, asdict(found), found.report, title, draw=lambda axes: plot_steps(p, found, axes))
    return 0


def shape_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of both."""
    parser.epilog = (
        "Set amplitude, frequency and slewrate with --set, such as --set amplitude=200."
        if parser.prog.endswith("shape")
        else "Hold times help at high frequencies, such as --set frequency=10000."
    )
    add_parameters(parser)
    text = "write the parameters, for --config and ROS"
    option(parser, "--out", "FILE.yaml", text, Path)
    text = "write time and voltage of a cycle, for a generator or `waveform: table`, or draw it"
    option(parser, "--waveform", "FILE.csv|svg|pdf|png", text, Path)
    text = "of the points in that file (default: the corners of the waveform)"
    option(parser, "--generator-rate", "HZ", text, quantity("Hz"))
    add_outputs(parser, "the runner before and with what was found, in its third cycle from rest")


def run_shape(args: argparse.Namespace) -> int:
    """Search, write and print the waveform."""
    check_outputs(args, args.out, args.waveform)
    if args.generator_rate is not None and not args.waveform:
        raise UsageError("--generator-rate is of the points in a --waveform FILE.csv; give it, too")
    if args.waveform and args.waveform.suffix.lower() not in (".csv", *PICTURES):
        raise UsageError(
            f"--waveform is {args.waveform}; its name has to end with .csv, {', '.join(PICTURES)}"
        )
    p = parameters_from(args)
    found, wanted = (_shape if args.command == "shape" else _elongate)(p)
    report_left_out(args.command, found.left_out)
    whole = p.replace(**wanted)
    if args.waveform:  # first, as a rate may be refused
        _save_waveform(args.waveform, whole, args.generator_rate)
    if args.out:
        write_text(args.out, yaml_text(whole))
    content = {**asdict(found), "parameters": whole.flat()}
    put_out(
        args, content, lambda: f"{found.report()}\n\n{yaml_lines(wanted)}",
        "Slip in two parts" if args.command == "shape" else "Hold times around the slip",
        draw=lambda axes: _draw(p, whole, axes),
    )  # fmt: skip
    return 0


elongate_arguments, run_elongate = shape_arguments, run_shape


def _draw(before: Parameters, after: Parameters, axes: Axes) -> None:
    from stickslip_ros.simulation.run import simulate

    lines = []
    for p, colour, name in ((before, MEASURED, "as given"), (after, SIMULATED, "as found")):
        trace = simulate(p, steps=3).trace
        shown = trace.t >= 2.0 / p.drive.frequency
        t, x = trace.t[shown], trace.x[shown]
        lines.append((t - t[0], x - x[0], "-", colour, name))
    draw_lines(axes, lines, "time in the cycle (s)", "runner (m)")


def _save_waveform(path: Path, p: Parameters, rate: float | None) -> None:
    """Write time and voltage of a cycle, or their picture. Raises ParameterError, WriteError."""
    import numpy as np  # as all that computes, only when it is asked for

    from stickslip_ros.physics.model.waveforms import shape_of
    from stickslip_ros.physics.waveforms.table import OF_GENERATOR, generator_rows

    rows = generator_rows(p.drive, shape_of(p.drive), rate)
    if path.suffix.lower() == ".csv":
        write_text(path, "\n".join([OF_GENERATOR, *(f"{t!r}, {v!r}" for t, v in rows), ""]))
        return
    from stickslip_ros.base.reporting.picture import picture_of, save_picture

    times, volts = np.array(rows).T
    line = (times, volts, "-", SIMULATED, p.drive.waveform)
    drawn = picture_of(lambda axes: draw_lines(axes, [line], "time (s)", "voltage (V)"))
    save_picture(path, drawn)


def _shape(p: Parameters) -> tuple[ShapedSlip, Mapping[str, Any]]:
    """Return the slip, and the parameters to change."""
    from stickslip_ros.simulation.waveform_search import shape_slip

    with announce_if_slow("searching the slip that leaves the least ringing", in_pipes=True):
        found = shape_slip(p)
    wanted: dict[str, Any] = {"waveform": "shaped", "split": found.split, "latency": found.latency}
    if p.drive.waveform == "sawtooth":
        wanted |= {"hold_before": 0.0, "hold_after": 0.0}
    return found, wanted


def _elongate(p: Parameters) -> tuple[ElongatedStep, Mapping[str, Any]]:
    """Return the hold times, and the parameters to change."""
    from stickslip_ros.simulation.waveform_search import elongate_step

    with announce_if_slow("searching the hold times of the largest step", in_pipes=True):
        found = elongate_step(p)
    waveform = "shaped" if p.drive.waveform == "shaped" else "hold"
    holds = {"hold_before": found.hold_before, "hold_after": found.hold_after}
    return found, {"waveform": waveform, **holds}
