# SPDX-License-Identifier: Apache-2.0
"""``stickslip identify``: from measurements to the parameters of the contact."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stickslip_ros.base.errors import INTERRUPTED, UsageError
from stickslip_ros.base.files import write_text
from stickslip_ros.base.reporting import format_si
from stickslip_ros.base.shared_files import config_file
from stickslip_ros.cli.measurement_options import add_measurement_options, measurement_of
from stickslip_ros.cli.options import option, progress_bar, repeated, report_left_out
from stickslip_ros.cli.outputs import add_outputs, check_outputs, put_out
from stickslip_ros.physics.parameters import PARAMETERS, parameter, yaml_text
from stickslip_ros.physics.parameters.bounded_files import read_values
from stickslip_ros.physics.parameters.row import read_quantity
from stickslip_ros.simulation.left_out import OF_A_FIT, left_out

if TYPE_CHECKING:
    from tqdm import tqdm


#: Steps of the bar of one stage.
_PARTS = 100


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the subcommand."""
    parser.epilog = (
        "Exit code 1 if no parameters explain the measurements (misfit). "
        "docs/identification.md explains method, intervals and what cannot be known."
    )
    pairs: dict[str, Any] = {"nargs": 2, "action": "append", "default": []}
    text = "measured motions of the drive of --config"
    option(parser, "measurements", "MEASUREMENT", text, Path, nargs="*")
    text = "what is known of the drive, in place of --run PARAMETERS.yaml for each"
    option(parser, "--config", "FILE.yaml", text, Path)
    text = "what is known of a drive, and a measured motion of it; may be repeated"
    option(parser, "--run", ("PARAMETERS.yaml", "MEASUREMENT"), text, Path, dest="runs", **pairs)
    text = "what is known of a drive, and a table of metrics over parameters; may be repeated"
    option(parser, "--curve", ("PARAMETERS.yaml", "TABLE"), text, Path, dest="curves", **pairs)
    option(parser, "--fit", "A,B", "free parameters (default: those of the friction law)")
    text = "what is known of a free parameter beforehand"
    repeated(parser, "--prior", "NAME=MEAN:SD", text)
    text = "where a free parameter may lie (default: what ringing and stroke leave)"
    repeated(parser, "--bounds", "NAME=LOW:HIGH", text)
    text = (
        "standard deviation of an input, such as preload=20mN; or `preload: 0.4 +- 0.02` in a file"
    )
    repeated(parser, "--uncertain", "NAME=SD", text)
    parser.add_argument(
        "--samples", choices=["point", "mean"],
        help="whether a sample is of an instant, or a mean over the time from one to the next "
        "(default: not known, which intervals allow for)",
    )  # fmt: skip
    parser.add_argument(
        "--fit-lag", action=argparse.BooleanOptionalAction, default=None,
        help="whether the amplifier may lag, so that intervals allow for it (default: if no "
        "amplifier_bandwidth is given)",
    )  # fmt: skip
    text = "write the parameters of the first run with the values found"
    option(parser, "--out", "FILE.yaml", text, Path)
    text = "data and fit, residuals, profiles"
    add_outputs(parser, text, "values and intervals")
    add_measurement_options(parser)


def run(args: argparse.Namespace) -> int:
    """Run the subcommand; return the exit code."""
    from stickslip_ros.base.compiled import report_compilation
    from stickslip_ros.cli.pages.fitted import fit_page
    from stickslip_ros.measurement.bags.load_motion import is_parameter_file
    from stickslip_ros.measurement.identification import Prior, identify, read_curve
    from stickslip_ros.measurement.identification.known import Known, deviation_of

    if bool(args.measurements) != bool(args.config):
        raise UsageError("--config FILE.yaml and its MEASUREMENT go together")
    args.runs = [*args.runs, *((args.config, path) for path in args.measurements)]
    check_outputs(args, args.out)
    bounds = _pairs(args.bounds, "--bounds", "LOW:HIGH")
    priors = {name: Prior(*pair) for name, pair in _pairs(args.prior, "--prior", "MEAN:SD").items()}
    for name, prior in priors.items():
        if not prior.deviation > 0.0:
            raise UsageError(
                f"--prior {name} has a standard deviation of {prior.deviation:g}; "
                "it has to be above 0"
            )
    names = [name.strip() for name in args.fit.split(",")] if args.fit else None
    for drive, path in (*args.runs, *args.curves):
        if is_parameter_file(path) and not is_parameter_file(drive):
            raise UsageError(
                f"{path} is a parameter file; give it first, then the measurement: {path} {drive}"
            )
    pairs = (one.partition("=") for one in args.uncertain)
    uncertain = {parameter(name.strip()).name: deviation_of(name.strip(), text)
                 for name, _, text in pairs}  # fmt: skip
    runs = [(drive, measurement_of(args, path)[0]) for drive, path in args.runs]
    curves = [(drive, read_curve(path, args.decimal)) for drive, path in args.curves]
    if not runs and not curves:
        raise UsageError("nothing is measured; give --run or --curve")
    for drive, _ in runs:
        report_left_out("identify", left_out(Known.of(drive).parameters, OF_A_FIT))
    for drive, _ in curves:
        report_left_out("identify", left_out(Known.of(drive).parameters))
    with report_compilation(), progress_bar(_PARTS, "identifying") as bar:
        found = identify(
            runs, names, bounds=bounds, priors=priors, curves=curves, uncertain=uncertain,
            samples=args.samples, fit_lag=args.fit_lag, progress=partial(_show, bar),
            say=lambda note: print(note, file=sys.stderr),
        )  # fmt: skip
    if args.out:
        given = read_values(config_file((args.runs or args.curves)[0][0]), PARAMETERS)
        write_text(args.out, found.comments() + yaml_text(found.base, given))
    heading = ("parameter", "unit", "value", "low 95 %", "high 95 %")
    rows = [(name, p.unit, p.value, p.low, p.high) for name, p in found.parameters.items()]
    put_out(
        args, found.as_json(), found.report, ", ".join(found.sources), (heading, rows),
        page=lambda: fit_page(found),
    )  # fmt: skip
    if not found.complete:
        print("stickslip identify: interrupted; this is the best so far", file=sys.stderr)
        return INTERRUPTED
    if found.misfit:
        print(f"stickslip identify: misfit: {found.misfit.text}", file=sys.stderr)
        return 1
    return 0


def _pairs(texts: list[str], option: str, form: str) -> dict[str, tuple[float, float]]:
    """Read NAME=A:B. Raises UsageError and ParameterError."""
    from stickslip_ros.measurement.identification.free import unit_of

    found = {}
    for text in texts:
        name, _, values = text.partition("=")
        known = parameter(name.strip()).name
        try:
            first, second = (read_quantity(part, unit_of(known)) for part in values.split(":"))
        except ValueError:
            first = second = math.nan
        if not (math.isfinite(first) and math.isfinite(second)):
            raise UsageError(
                f"{option} is {text!r}; write it as NAME={form}, with units or in SI units"
            )
        found[known] = first, second
    return found


def _show(bar: tqdm[Any], what: str, part: float, best: Mapping[str, float]) -> None:
    """Show the present stage and the best values so far."""
    from stickslip_ros.measurement.identification.free import unit_of

    values = ", ".join(
        f"{name} {format_si(value, unit_of(name), 3)}" for name, value in best.items()
    )
    bar.set_description_str(what)
    bar.set_postfix_str(values, refresh=False)
    bar.n = round(_PARTS * part)
    bar.refresh()
