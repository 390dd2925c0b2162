# SPDX-License-Identifier: Apache-2.0
"""What subcommands share: parameters from files and the command line, progress, errors."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stickslip_ros.errors import StickslipError
from stickslip_ros.files import write_text
from stickslip_ros.parameters import (
    PARAMETERS,
    Parameters,
    parse_assignment,
    read_yaml,
    yaml_text,
)
from stickslip_ros.shared_files import config_file

if TYPE_CHECKING:
    from tqdm import tqdm

    from stickslip_ros.library.ensemble import Ensemble


#: Draws of an ensemble if nothing is said, and how many there may be.
_DRAWS, _FEWEST_DRAWS, _MOST_DRAWS = 200, 10, 100_000


class UsageError(StickslipError, ValueError):
    """A command line that cannot be carried out; the message says what to change."""


def add_parameters(parser: argparse.ArgumentParser) -> None:
    """Add --config and --set."""
    parser.add_argument(
        "--config",
        type=Path,
        metavar="FILE.yaml",
        help="ROS parameter file, or the name of one in config/",
    )
    add_assignments(parser)


def add_assignments(parser: argparse.ArgumentParser | argparse._ArgumentGroup) -> None:
    """Add --set."""
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        dest="assignments",
        help="set one parameter, may be repeated; --list-parameters shows the names",
    )
    parser.add_argument(
        "--list-parameters",
        action=_ListParameters,
        nargs=0,
        help="print all parameters with their ranges, and exit",
    )


class _ListParameters(argparse.Action):
    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> None:
        from stickslip_ros.model.friction import constants_in_force

        friction = Parameters().friction
        own = constants_in_force(friction)._asdict()
        for row in PARAMETERS.values():
            usual = f"{row.default:g}" if row.kind in (int, float) else f"{row.default}"
            if row.optional and not row.default:
                law = f"{own[row.name]:g} ({friction.model})" if own.get(row.name) else ""
                usual = law or "not set"
            span = f"{row.low:g} to {row.high:g}" if row.kind in (int, float) else ""
            print(f"{row.name:<20} {usual:<16} {span:<21} {row.unit:<6} {row.description}".rstrip())
        parser.exit()


def parameters_of(args: argparse.Namespace, **overrides: Any) -> Parameters:
    """Return the full set: defaults, then --config, then --set, then overrides that are not None.

    Raises ParameterError.
    """
    p = read_yaml(config_file(args.config)) if args.config else Parameters()
    values: dict[str, Any] = dict(parse_assignment(text) for text in args.assignments)
    values.update({name: value for name, value in overrides.items() if value is not None})
    return p.replace(**values)


#: Effects of docs/effects.md that a steady cycle does not show: creep, a past, chance
PASSING = ("creep", "actuator_memory", "surface_spread", "slip_spread")
#: All that makes a cycle differ from that of a rigid actuator on a contact that knows no time
EFFECTS = (
    *PASSING, "dwell_growth", "rate_growth", "amplifier_bandwidth", "amplifier_slew",
    "actuator_resonance", "contacts",
)  # fmt: skip


def tell_left_out(p: Parameters, command: str, effects: Sequence[str] = PASSING) -> None:
    """Say on stderr which of the effects that are on a command leaves out."""
    values = p.flat()
    on = [name for name in effects if values[name] != PARAMETERS[name].default]
    if on:
        print(f"stickslip {command}: leaves out {', '.join(on)}", file=sys.stderr)


def add_ensemble(parser: argparse.ArgumentParser, what: str) -> None:
    """Add --ensemble and --draws; what is what they make the command show."""
    parser.add_argument(
        "--ensemble",
        type=Path,
        metavar="FITTED.yaml",
        help=f"a file of stickslip identify --out: {what}",
    )
    parser.add_argument(
        "--draws",
        type=int,
        default=_DRAWS,
        metavar="N",
        help=f"of the ensemble (default: {_DRAWS})",
    )


def ensemble_of(args: argparse.Namespace) -> Ensemble | None:
    """Return the ensemble of --ensemble and take its file as --config; None without.

    Raises UsageError and EnsembleError.
    """
    if args.ensemble is None:
        return None
    if args.config is not None:
        raise UsageError("--ensemble FITTED.yaml is the parameter file, too; leave --config out")
    if not _FEWEST_DRAWS <= args.draws <= _MOST_DRAWS:
        raise UsageError(
            f"--draws is {args.draws}; it has to be from {_FEWEST_DRAWS} to {_MOST_DRAWS}"
        )
    from stickslip_ros.library.ensemble import read_ensemble

    found = read_ensemble(args.ensemble)
    given = {parse_assignment(text)[0] for text in args.assignments}
    for name in given & set(found.names):
        raise UsageError(f"--set {name}: the ensemble draws it; leave one of the two out")
    args.config = args.ensemble
    return found


def add_yaml(parser: argparse.ArgumentParser) -> None:
    """Add --yaml, a file that `save_parameters` writes."""
    parser.add_argument(
        "--yaml", type=Path, metavar="FILE.yaml", help="write the parameters, for --config and ROS"
    )


def save_parameters(p: Parameters, path: Path) -> None:
    """Write what differs from the defaults as a ROS parameter file, all of it or nothing."""
    write_text(path, yaml_text(p))


def yaml_lines(values: Mapping[str, object]) -> str:
    """Return parameters as lines of a YAML file."""
    import yaml

    return yaml.safe_dump(dict(values), sort_keys=False).rstrip()


@contextmanager
def progress_bar(total: int, what: str) -> Iterator[tqdm[Any]]:
    """A progress bar on stderr if that is a terminal and the work takes more than a moment."""
    from tqdm import tqdm

    with tqdm(total=total, desc=what, disable=not sys.stderr.isatty(), delay=0.5) as bar:
        yield bar


@contextmanager
def needing_ros() -> Iterator[None]:
    """Raise UsageError where an import in this block fails because there is no ROS."""
    try:
        yield
    except ImportError as error:
        raise UsageError(
            f"needs ROS 2: source it, or pip install 'stickslip_ros[ros]' ({error})"
        ) from None


def run_node(
    program: str, module: str, node: str, given: Mapping[str, Any], remaps: Sequence[str] = ()
) -> int:
    """Run a node class of ``stickslip_ros.ros`` until it ends; return its exit code.

    given are parameters by name, None for those that were not given; remaps have the form
    ``/old:=/new``. Raises UsageError where there is no ROS.
    """
    with needing_ros():
        from rclpy.parameter import Parameter

        from stickslip_ros.ros.process import run
    for remap in remaps:
        if ":=" not in remap:
            raise UsageError(f"--remap is {remap!r}; it has to look like /old:=/new")
    kind = getattr(import_module(f"stickslip_ros.ros.{module}"), node)
    overrides = [Parameter(name, value=value) for name, value in given.items() if value is not None]
    rules = [word for remap in remaps for word in ("-r", remap)]
    return run(
        program,
        [program, "--ros-args", *rules] if rules else [program],
        lambda stop_requested: kind(stop_requested, parameter_overrides=overrides),
    )
