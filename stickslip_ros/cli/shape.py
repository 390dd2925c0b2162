# SPDX-License-Identifier: Apache-2.0
"""Searches of a waveform: ``stickslip shape``, a quiet slip; ``elongate``, the largest step."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stickslip_ros.cli.options import (
    add_parameters,
    option,
    parameters_from,
    report_left_out,
    yaml_lines,
)
from stickslip_ros.cli.outputs import add_outputs, check_outputs, put_out
from stickslip_ros.files import write_text
from stickslip_ros.parameters import Parameters, yaml_text
from stickslip_ros.reporting import MEASURED, SIMULATED, draw_lines
from stickslip_ros.reporting.terminal import announce_if_slow

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from stickslip_ros.library.waveform_search import ElongatedStep, ShapedSlip


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of both."""
    parser.epilog = (
        "Set amplitude, frequency and slewrate with --set, such as --set amplitude=200."
        if parser.prog.endswith("shape")
        else "Hold times help at high frequencies, such as --set frequency=10000."
    )
    add_parameters(parser)
    text = "write the parameters, for --config and ROS"
    option(parser, "--out", "FILE.yaml", text, Path)
    option(parser, "--yaml", "FILE.yaml", argparse.SUPPRESS, Path, dest="out")  # its old name
    add_outputs(parser, "the runner before and with what was found, in its third cycle from rest")


def run(args: argparse.Namespace) -> int:
    """Search, write and print the waveform."""
    check_outputs(args, args.out)
    p = parameters_from(args)
    found, wanted = (_shape if args.command == "shape" else _elongate)(p)
    report_left_out(args.command, found.left_out)
    whole = p.replace(**wanted)
    if args.out:
        write_text(args.out, yaml_text(whole))
    content = {**asdict(found), "parameters": whole.flat()}
    put_out(
        args, content, lambda: f"{found.report()}\n\n{yaml_lines(wanted)}",
        "Slip in two parts" if args.command == "shape" else "Hold times around the slip",
        draw=lambda axes: _draw(p, whole, axes),
    )  # fmt: skip
    return 0


def _draw(before: Parameters, after: Parameters, axes: Axes) -> None:
    from stickslip_ros.library.run import simulate

    lines = []
    for p, colour, name in ((before, MEASURED, "as given"), (after, SIMULATED, "as found")):
        trace = simulate(p, steps=3).trace
        shown = trace.t >= 2.0 / p.drive.frequency
        t, x = trace.t[shown], trace.x[shown]
        lines.append((t - t[0], x - x[0], "-", colour, name))
    draw_lines(axes, lines, "time in the cycle (s)", "runner (m)")


def _shape(p: Parameters) -> tuple[ShapedSlip, Mapping[str, Any]]:
    """Return the slip, and the parameters to change."""
    from stickslip_ros.library.waveform_search import shape_slip

    with announce_if_slow("searching the slip that leaves the least ringing", in_pipes=True):
        found = shape_slip(p)
    wanted: dict[str, Any] = {"waveform": "shaped", "split": found.split, "latency": found.latency}
    if p.drive.waveform == "sawtooth":
        wanted |= {"hold_before": 0.0, "hold_after": 0.0}
    return found, wanted


def _elongate(p: Parameters) -> tuple[ElongatedStep, Mapping[str, Any]]:
    """Return the hold times, and the parameters to change."""
    from stickslip_ros.library.waveform_search import elongate_step

    with announce_if_slow("searching the hold times of the largest step", in_pipes=True):
        found = elongate_step(p)
    waveform = "shaped" if p.drive.waveform == "shaped" else "hold"
    holds = {"hold_before": found.hold_before, "hold_after": found.hold_after}
    return found, {"waveform": waveform, **holds}
