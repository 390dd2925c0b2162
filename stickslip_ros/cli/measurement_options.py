# SPDX-License-Identifier: Apache-2.0
"""What subcommands share that take a measurement: how to read it and which part of it."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from stickslip_ros.cli.options import UsageError
from stickslip_ros.measurement.load_motion import load_motion
from stickslip_ros.measurement.tables import MeasurementError, parse_pairs
from stickslip_ros.traces.motion import Motion

#: Samples below which nothing can be said.
_FEWEST = 16


def add_measurement_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that say how a measurement is read."""
    reading = parser.add_argument_group("reading the measurement")
    reading.add_argument(
        "--columns", metavar="t=NAME,x=NAME", default="", help="names, or numbers from 1"
    )
    reading.add_argument("--units", metavar="t=UNIT,x=UNIT", default="", help="such as t=ms,x=nm")
    reading.add_argument("--joint", metavar="NAME", help="in bags (default: the slider)")
    reading.add_argument("--from", dest="first", type=float, metavar="S", help="leave out before")
    reading.add_argument("--to", dest="last", type=float, metavar="S", help="leave out after")


def measurement_of(args: argparse.Namespace, path: Path, origin_ns: int | None = None) -> Motion:
    """Return the motion measured in a file, cut as the options say.

    origin_ns is the time (ns) that the stamps of a bag count from (default: its first message).
    Raises UsageError and BagError.
    """
    try:
        columns, units = (parse_pairs(text) if text else {} for text in (args.columns, args.units))
        measurement = load_motion(
            path, columns=columns, units=units, joint=args.joint, origin_ns=origin_ns
        ).motion
    except MeasurementError as error:
        raise UsageError(str(error)) from None
    start = -math.inf if args.first is None else args.first
    end = math.inf if args.last is None else args.last
    kept = measurement.between(start, end)
    if len(kept.t) < _FEWEST:
        raise UsageError(
            f"{len(kept.t)} samples lie between --from and --to; the measurement goes from "
            f"{measurement.t[0]:g} s to {measurement.t[-1]:g} s"
        )
    return kept
