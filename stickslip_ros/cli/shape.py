# SPDX-License-Identifier: Apache-2.0
"""Searches of a waveform: ``stickslip shape``, a quiet slip; ``elongate``, the largest step."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stickslip_ros.cli.options import (
    add_outputs,
    add_parameters,
    check_outputs,
    option,
    parameters_from,
    print_result,
    report_left_out,
    yaml_lines,
)
from stickslip_ros.files import write_text
from stickslip_ros.parameters import Parameters, yaml_text
from stickslip_ros.reporting.terminal import announce_if_slow, micro_prefix

if TYPE_CHECKING:
    from stickslip_ros.library.waveform_search import ElongatedStep, ShapedSlip

_Found = tuple["ShapedSlip | ElongatedStep", Mapping[str, Any], Sequence[tuple[str, str, str]]]


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of both."""
    parser.epilog = (
        "Set amplitude, frequency and slewrate with --set, such as --set amplitude=200."
        if parser.prog.endswith("shape")
        else "Hold times help at high frequencies, such as --set frequency=10000."
    )
    add_parameters(parser)
    text = "write the parameters, for --config and ROS"
    option(parser, "--yaml", "FILE.yaml", text, Path)
    add_outputs(parser)


def run(args: argparse.Namespace) -> int:
    """Search, write and print the waveform."""
    check_outputs(args, args.yaml)
    p = parameters_from(args)
    found, wanted, rows = (_shape if args.command == "shape" else _elongate)(p)
    report_left_out(args.command, found.left_out)
    whole = p.replace(**wanted)
    if args.yaml:
        write_text(args.yaml, yaml_text(whole))
    lines = [f"{name:<14}{before:<16}{after}".rstrip() for name, before, after in rows]
    content = {**asdict(found), "parameters": whole.flat()}
    print_result(args, content, lambda: "\n".join([*lines, "", yaml_lines(wanted)]))
    return 0


def _shape(p: Parameters) -> _Found:
    """Return the slip, the parameters to change, and the table for people."""
    from stickslip_ros.library.waveform_search import shape_slip

    with announce_if_slow("searching the slip that leaves the least ringing", in_pipes=True):
        found = shape_slip(p)
    wanted: dict[str, Any] = {"waveform": "shaped", "split": found.split, "latency": found.latency}
    if p.drive.waveform == "sawtooth":
        wanted |= {"hold_before": 0.0, "hold_after": 0.0}
    return (
        found,
        wanted,
        [
            ("", "single slip", "shaped slip"),
            (
                "ringing",
                f"{1e9 * found.ringing_before:.3f} nm",
                f"{1e9 * found.ringing_after:.3f} nm",
            ),
            ("step size", f"{1e9 * found.step_before:.3f} nm", f"{1e9 * found.step_after:.3f} nm"),
            ("split", "", f"{100 * found.split:.2f} %"),
            ("latency", "", f"{1e6 * found.latency:.3f} {micro_prefix()}s"),
            ("", "", f"{found.latency / found.ringing_period:.3f} ringing periods"),
        ],
    )


def _elongate(p: Parameters) -> _Found:
    """Return the hold times, the parameters to change, and the table for people."""
    from stickslip_ros.library.waveform_search import elongate_step

    with announce_if_slow("searching the hold times of the largest step", in_pipes=True):
        found = elongate_step(p)
    wanted = {
        "waveform": "shaped" if p.drive.waveform == "shaped" else "hold",
        "hold_before": found.hold_before,
        "hold_after": found.hold_after,
    }
    return (
        found,
        wanted,
        [
            ("", "without holds", "with holds"),
            ("step size", f"{1e9 * found.step_before:.3f} nm", f"{1e9 * found.step_after:.3f} nm"),
            ("hold before", "", f"{100 * found.hold_before:.2f} % of the period"),
            ("hold after", "", f"{100 * found.hold_after:.2f} % of the period"),
        ],
    )
