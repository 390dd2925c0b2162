# SPDX-License-Identifier: Apache-2.0
"""``stickslip identify``: from measurements to the parameters of the contact."""

from __future__ import annotations

import argparse
import json
import math
import shlex
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stickslip_ros.cli.measurement_options import add_measurement_options, measurement_of
from stickslip_ros.cli.options import UsageError, progress_bar, tell_left_out
from stickslip_ros.files import check_folder, write_text
from stickslip_ros.parameters import parameter, read_yaml, yaml_text
from stickslip_ros.reporting import shown
from stickslip_ros.reporting.tables import check_table, write_table
from stickslip_ros.shared_files import config_file

if TYPE_CHECKING:
    from stickslip_ros.identification import Fit

_INTERRUPTED = 130
#: Steps of the bar of one stage.
_PARTS = 100


def add_parser(subparsers: argparse._SubParsersAction) -> None:  # type: ignore[type-arg]
    """Add the subcommand."""
    parser = subparsers.add_parser(
        "identify",
        epilog="Exit code 1 if no parameters explain the measurements (misfit). "
        "docs/identification.md explains method, intervals and what cannot be known.",
    )
    parser.add_argument(
        "--run", nargs=2, action="append", default=[], type=Path, dest="runs",
        metavar=("PARAMETERS.yaml", "MEASUREMENT"),
        help="what is known of a drive, and a measured motion of it; may be repeated",
    )  # fmt: skip
    parser.add_argument(
        "--curve", nargs=2, action="append", default=[], type=Path, dest="curves",
        metavar=("PARAMETERS.yaml", "TABLE"),
        help="what is known of a drive, and measured metrics over varied parameters; may be "
        "repeated",
    )  # fmt: skip
    parser.add_argument(
        "--fit", metavar="A,B", help="free parameters (default: those of the friction law)"
    )
    parser.add_argument(
        "--prior", action="append", default=[], metavar="NAME=MEAN:SD",
        help="what is known of a free parameter beforehand, SI units",
    )  # fmt: skip
    parser.add_argument(
        "--bounds", action="append", default=[], metavar="NAME=LOW:HIGH",
        help="where a free parameter may lie, SI units (default: 10 times about its start)",
    )  # fmt: skip
    parser.add_argument("--fit-gain", action="store_true", help="fit the gain of the sensor, too")
    parser.add_argument(
        "--fit-lag", action="store_true",
        help="fit a lag of the amplifier, too: intervals then allow for it",
    )  # fmt: skip
    parser.add_argument(
        "--next", action="store_true", dest="suggest_next",
        help="look for the run that would narrow the widest interval most",
    )  # fmt: skip
    parser.add_argument(
        "--laws", nargs="?", const="", metavar="A,B",
        help="rank friction laws, all or those that are named, by how well they predict what they "
        "were not fitted to",
    )  # fmt: skip
    parser.add_argument("--seed", type=int, default=1, help="of the search (default: 1)")
    parser.add_argument(
        "--out", type=Path, metavar="FILE.yaml",
        help="write the parameters of the first run with the values found",
    )  # fmt: skip
    parser.add_argument(
        "--report", type=Path, metavar="FILE.html",
        help="write a page: data and fit, residuals, profiles, correlations, starts",
    )  # fmt: skip
    parser.add_argument(
        "--table", type=Path, metavar="FILE.csv|FILE.tex",
        help="write values and intervals, SI units",
    )  # fmt: skip
    parser.add_argument("--json", action="store_true", help="print one JSON object, SI units")
    add_measurement_options(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run the subcommand; return the exit code."""
    from stickslip_ros.compiled import telling_when_compiling
    from stickslip_ros.identification import Prior, identify, read_curve
    from stickslip_ros.measurement.reading import MeasurementError

    if args.table:
        check_table(args.table)
    for path in (args.out, args.report):
        if path:
            check_folder(path)
    if args.seed < 0:
        raise UsageError(f"--seed is {args.seed}; it has to be 0 or more")
    bounds = _pairs(args.bounds, "--bounds", "LOW:HIGH")
    priors = {name: Prior(*pair) for name, pair in _pairs(args.prior, "--prior", "MEAN:SD").items()}
    for name, prior in priors.items():
        if not prior.deviation > 0.0:
            raise UsageError(
                f"--prior {name} has a standard deviation of {prior.deviation:g}; "
                "it has to be above 0"
            )
    names = [name.strip() for name in args.fit.split(",")] if args.fit else None
    runs = [
        (read_yaml(config_file(drive)), measurement_of(args, path)) for drive, path in args.runs
    ]
    try:
        curves = [
            (read_yaml(config_file(drive)), read_curve(path, args.decimal))
            for drive, path in args.curves
        ]
    except MeasurementError as error:
        raise UsageError(str(error)) from None
    if not runs and not curves:
        raise UsageError("nothing is measured; give --run or --curve")
    for known, _ in runs:
        tell_left_out(known, "identify", ("surface_spread", "slip_spread", "sensor_bandwidth"))
    for known, _ in curves:
        tell_left_out(known, "identify")
    with telling_when_compiling(), _Progress() as progress:
        found = identify(
            runs,
            names,
            bounds=bounds,
            priors=priors,
            curves=curves,
            fit_gain=args.fit_gain,
            fit_lag=args.fit_lag,
            suggest_next=args.suggest_next,
            laws=_laws(args.laws),
            seed=args.seed,
            progress=progress,
        )
    if args.out:
        write_text(args.out, _remarks(found) + yaml_text(found.base))
    if args.table:
        rows = [(name, p.unit, p.value, p.low, p.high) for name, p in found.parameters.items()]
        write_table(args.table, ("parameter", "unit", "value", "low 95 %", "high 95 %"), rows)
    if args.report:
        from stickslip_ros.identification.page import write_page

        write_page(args.report, found, shlex.join(["stickslip", *sys.argv[1:]]))
    print(json.dumps(found.as_json(), allow_nan=False) if args.json else _table(found))
    if not found.complete:
        print("stickslip identify: interrupted; this is the best so far", file=sys.stderr)
        return _INTERRUPTED
    if found.misfit:
        print(f"stickslip identify: misfit: {found.misfit.text}", file=sys.stderr)
        return 1
    return 0


def _laws(text: str | None) -> list[str]:
    """Return the laws to rank: none without the option, all if it names none."""
    from stickslip_ros.identification import LAWS

    if text is None:
        return []
    return [name.strip() for name in text.split(",")] if text else list(LAWS)


def _pairs(texts: list[str], option: str, form: str) -> dict[str, tuple[float, float]]:
    """Read NAME=A:B. Raises UsageError and ParameterError."""
    from stickslip_ros.identification.free import LAG

    found = {}
    for text in texts:
        name, _, values = text.partition("=")
        try:
            first, second = (float(part) for part in values.split(":"))
        except ValueError:
            first = second = math.nan
        if not (math.isfinite(first) and math.isfinite(second)):
            raise UsageError(f"{option} is {text!r}; write it as NAME={form}, SI units")
        known = name.strip()
        found[known if known == LAG else parameter(known).name] = first, second
    return found


class _Progress:
    """Shows on a terminal what is being done, and the best values so far."""

    def __enter__(self) -> _Progress:
        self._manager = progress_bar(_PARTS, "identify")
        self._bar = self._manager.__enter__()
        return self

    def __exit__(self, *error: Any) -> None:
        self._manager.__exit__(*error)

    def __call__(self, what: str, part: float, best: Mapping[str, float]) -> None:
        from stickslip_ros.identification.free import unit_of

        values = ", ".join(
            f"{name} {shown(value, unit_of(name), 3)}" for name, value in best.items()
        )
        self._bar.set_description_str(what)
        self._bar.set_postfix_str(values, refresh=False)
        self._bar.n = round(_PARTS * part)
        self._bar.refresh()


def _sources(found: Fit) -> list[str]:
    return [*(run.source for run in found.runs), *(one.source for one in found.curves)]


def _remarks(found: Fit) -> str:
    """Return the comments at the top of the file that is written."""
    lines = [f"identified from {', '.join(_sources(found))}; 95 % intervals, SI units"]
    if not found.complete:
        lines = ["INTERRUPTED: the best so far, not the result of an identification"]
    for name, one in found.parameters.items():
        low, high = (("-" if end is None else f"{end:.4g}") for end in (one.low, one.high))
        lines.append(f"{name}: {one.value:.5g} {one.unit}, from {low} to {high}")
    lines += found.unknown
    if found.ensemble:
        lines.append(found.ensemble.comment())
    if found.misfit:
        lines.append(f"MISFIT: {found.misfit.text}")
    return "".join(f"# {line}\n" for line in lines)


def _table(found: Fit) -> str:
    lines = [f"{'parameter':<16} {'value':>14} {'low (95 %)':>14} {'high (95 %)':>14}"]
    for name, one in found.parameters.items():
        ends = [
            "–" if end is None else shown(end, one.unit, 4, like=one.value)
            for end in (one.low, one.high)
        ]
        mark = "" if one.determined or not found.complete else "  not determined"
        if one.at_bound:
            mark = "  on a bound of the search"
        value = shown(one.value, one.unit, 4)
        lines.append(f"{name:<16} {value:>14} {ends[0]:>14} {ends[1]:>14}{mark}")
    lines.append("")
    for run in found.runs:
        hum = f", hum of {' and '.join(f'{f:g}' for f in run.mains)} Hz" if run.mains else ""
        lines.append(
            f"{run.source}: {abs(run.steps)} steps, noise {shown(run.noise, 'm', 3)} a sample{hum}"
        )
    for curve in found.curves:
        lines.append(f"{curve.source}: {curve.points} points")
    lines += found.unknown
    if found.next:
        lines.append(f"next: {found.next.text}")
    if found.laws:
        lines += ["", f"{'law, best first':<16} {'constants':>14} {'score':>14} {'left':>14}"]
    for law in found.laws:
        left = shown(law.residual, "m", 3)
        lines.append(f"{law.law:<16} {len(law.parameters):>14} {law.score:>14.1f} {left:>14}")
    if found.laws_alike:
        lines.append(found.laws_alike)
    return "\n".join(lines)
