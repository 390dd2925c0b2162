# SPDX-License-Identifier: Apache-2.0
"""Shared by subcommands that read a measurement: options for its columns and its part."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from stickslip_ros.base.errors import UsageError
from stickslip_ros.base.reporting import format_si
from stickslip_ros.base.reporting.terminal import SEARCH, announce_if_slow
from stickslip_ros.base.shared_files import sample_file
from stickslip_ros.cli.options import flag, option, quantity, repeated, several

if TYPE_CHECKING:
    from stickslip_ros.measurement.reading import Reading
    from stickslip_ros.measurement.steps.analysis import Findings
    from stickslip_ros.measurement.steps.drive import Drive
    from stickslip_ros.measurement.steps.run import Run
    from stickslip_ros.simulation.motion import Motion

#: Samples below which nothing can be said.
_FEWEST = 16


def add_reading_options(parser: argparse.ArgumentParser, keys: str = "t,x", more: str = "") -> None:
    """Add the options that say how the columns of a file are read; more is said of --columns."""
    first, second = keys.split(",")
    reading = parser.add_argument_group("reading the measurement")
    for name, example, text in (
        ("columns", f"{first}=NAME,{second}=NAME", f"columns, by name or by number from 1{more}"),
        ("units", f"{first}=UNIT,{second}=UNIT", "units of columns, such as ms, nm, mV"),
        ("scale", f"{second}=50nm/V", "length for one unit of a column; a minus inverts the sign"),
    ):
        repeated(reading, f"--{name}", example, text)
    option(reading, "--rate", "HZ", "sampling rate, if there is no time", quantity("Hz"))
    option(reading, "--rows", "FIRST:LAST", "rows of numbers to use, from 1")
    reading.add_argument("--decimal", choices=[".", ","], help="decimal sign (default: found)")


def add_measurement_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that say how a measurement is read."""
    add_reading_options(parser, more="; u is a deflection, of voltage only the cycles count")
    reading = parser.add_argument_group("which motion, and which part of it")
    text = "angle between the axis of the sensor and the motion (default: 0)"
    option(reading, "--sensor-angle", "DEG", text, quantity("deg"), default=0.0)
    text = "of an interferometer: jumps by halves of it are taken out, such as 633nm"
    option(reading, "--wavelength", "M", text, quantity("m"))
    option(reading, "--joint", "NAME", "joint to use in a bag (default: the only slider)")
    option(reading, "--from", "S", "ignore samples before", quantity("s"), dest="first")
    option(reading, "--to", "S", "ignore samples after", quantity("s"), dest="last")
    flag(reading, "--fit-position-drift", "take the drift of the position out")
    flag(reading, "--remove-hum", "take hum of 50 or 60 Hz and its harmonics out")


def add_drive_known(parser: argparse.ArgumentParser, config: bool = True) -> None:
    """Add the options that say how the axis was driven; config: whether --config is one."""
    known = parser.add_argument_group("how the axis was driven, as far as it is known")
    for name, metavar, text, kind in (
        ("--frequency", "HZ", "frequency of the drive", quantity("Hz")),
        ("--steps", "N", "steps that were sent, the sign is the direction", int),
    ):
        text += "; one for all runs, or one a run"
        option(known, name, f"{metavar}[,{metavar}]", text, several(kind))
    if config:
        option(known, "--config", "FILE.yaml", "the parameters of its drive", Path)


def drive_of(args: argparse.Namespace, motion: Motion, recorded: Drive | None = None) -> Drive:
    """Return what is known of the drive of a measurement. Raises UsageError.

    Options are used before the file of its parameters, these before a voltage that was measured,
    and that before what a bag has recorded.
    """
    from stickslip_ros.measurement.steps.drive import Drive
    from stickslip_ros.measurement.steps.record import TraceError
    from stickslip_ros.physics.parameters import Parameters

    frequency = args.frequency
    try:
        if frequency is None and args.config is not None:
            frequency = Parameters.of(args.config).drive.frequency
        return Drive.given(frequency, args.steps).or_recorded(motion, recorded)
    except TraceError as error:
        raise UsageError(str(error)) from None


def reading_of(args: argparse.Namespace) -> Reading:
    """Return how the options say that a file is read. Raises UsageError, MeasurementError."""
    from stickslip_ros.measurement.reading import Reading

    angle = getattr(args, "sensor_angle", 0.0)
    if not -85.0 <= angle <= 85.0:
        raise UsageError(f"--sensor-angle is {angle:g} degrees; it has to lie between -85 and 85")
    given = ("columns", "units", "scale", "rate", "rows", "decimal")
    return Reading(
        **{name: getattr(args, name) for name in given},
        angle=math.radians(angle),
        wavelength=getattr(args, "wavelength", None),
    )


def measurement_of(
    args: argparse.Namespace,
    path: Path,
    origin_ns: int | None = None,
    finer: bool = False,
    read: Callable[[Path, Reading, str | None], Motion] | None = None,
) -> tuple[Motion, Drive | None]:
    """Return the motion measured in a file, cut as the options say, and the drive that it holds.

    The notes of the reader are printed on stderr.

    origin_ns is the time (ns) that the stamps of a bag count from (default: its first message);
    with finer, a bag of an axis of ours is simulated again where its samples do not suffice. read
    takes the file, how it is read and the joint, in place of `load_motion`. Raises UsageError and
    BagError.
    """
    from stickslip_ros.measurement.bags.load_motion import load_motion

    how, file, drive = reading_of(args), sample_file(path), None
    if read is not None:
        measurement = read(file, how, args.joint)
    else:
        loaded = load_motion(file, how=how, joint=args.joint, origin_ns=origin_ns)
        measurement, drive = loaded.motion, loaded.drive
        if finer and loaded.parameters is not None:
            from stickslip_ros.measurement.bags.finer import finest_motion  # it needs the solver

            measurement = finest_motion(file, loaded)
    for note in measurement.notes:
        print(f"{path.name}: {note}", file=sys.stderr)
    start = -math.inf if args.first is None else args.first
    end = math.inf if args.last is None else args.last
    kept = measurement.between(start, end)
    if len(kept.t) < _FEWEST:
        raise UsageError(
            f"{len(kept.t)} samples lie between --from and --to; the measurement goes from "
            f"{measurement.t[0]:g} s to {measurement.t[-1]:g} s"
        )
    return kept, drive


def steps_in(
    args: argparse.Namespace, motion: Motion, drive: Drive, runner_only: bool = False
) -> tuple[Motion, Findings]:
    """Return a measurement without the disturbances that options remove, and its runs.

    stderr names what was left out, and a clear disturbance that remains with the option that
    removes it. Step sizes never include drift and hum. The cycles are those of the actuator, if it
    was measured and is not to be ignored. Raises TraceError.
    """
    from stickslip_ros.measurement.steps.analysis import find_steps

    def say(text: str) -> None:
        print(f"{motion.source}: {text}", file=sys.stderr)

    actuator = None if runner_only else motion.u
    with announce_if_slow(SEARCH):
        found = find_steps(motion.t, motion.x, drive, actuator)
    for note in found.notes:
        say(note)
    fitted = found.disturbances
    drift, hum = args.fit_position_drift, args.remove_hum
    if fitted.drifts and not drift:
        speed = f"{format_si(fitted.drift, 'm')}/s \u00b1 {format_si(fitted.drift_error, 'm', 2)}/s"
        say(f"the position drifts by {speed}; --fit-position-drift takes that out")
    if fitted.hums and not hum:
        size = format_si(fitted.hum, "m", 3)
        say(f"there is hum of {fitted.mains:g} Hz, amplitude {size}; --remove-hum takes it out")
    if not (drift and fitted.drift) and not (hum and fitted.mains):
        return motion, found
    clean = replace(motion, x=motion.x - fitted.at(motion.t, drift, hum), v=None)
    with announce_if_slow(SEARCH):
        again = find_steps(clean.t, clean.x, drive, actuator)
    return clean, replace(again, disturbances=fitted)


def say_doubts(source: Path | str, runs: Iterable[Run]) -> bool:
    """Print on stderr why runs of a measurement are not determined; return True if all are."""
    doubtful = [run for run in runs if run.doubts]
    for run in doubtful:
        print(
            f"{source}: the {run.steps} steps from {run.span} are not "
            f"determined: {'; '.join(run.doubts)}",
            file=sys.stderr,
        )
    return not doubtful
