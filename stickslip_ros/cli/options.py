# SPDX-License-Identifier: Apache-2.0
"""Shared by subcommands: options, parameters, progress, errors."""

from __future__ import annotations

import argparse
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stickslip_ros.base.errors import UsageError
from stickslip_ros.base.reporting.terminal import announce_if_slow
from stickslip_ros.base.shared_files import config_file
from stickslip_ros.physics.parameters import PARAMETERS, Parameters, parse_assignment
from stickslip_ros.physics.parameters.groups import AXIS_NODE
from stickslip_ros.physics.parameters.row import read_quantity

if TYPE_CHECKING:
    from tqdm import tqdm

_Adds = argparse.ArgumentParser | argparse._ArgumentGroup


def option(
    parser: _Adds, name: str, metavar: Any, text: str, kind: Callable[[str], Any] = str, **more: Any
) -> None:
    """Add an option with a value, or an argument; more are further arguments of argparse."""
    parser.add_argument(name, metavar=metavar, help=text, type=kind, **more)


def flag(parser: _Adds, name: str, text: str, **more: Any) -> None:
    """Add an option without a value."""
    parser.add_argument(name, action="store_true", help=text, **more)


def repeated(parser: _Adds, name: str, metavar: str, text: str, **more: Any) -> None:
    """Add an option that may be given several times."""
    parser.add_argument(name, metavar=metavar, help=text, action="append", default=[], **more)


def quantity(unit: str) -> Callable[[str], float]:
    """Return a parser of quantities with or without their unit, as ``type`` of an option."""

    def read(text: str) -> float:
        try:
            return read_quantity(text, unit)
        except ValueError as error:
            raise argparse.ArgumentTypeError(str(error)) from None

    return read


def several(kind: Callable[[str], Any]) -> Callable[[str], tuple[Any, ...]]:
    """Return a parser of values with commas between them, as ``type`` of an option."""

    def read(text: str) -> tuple[Any, ...]:
        try:
            return tuple(kind(one) for one in text.split(","))
        except ValueError:
            raise argparse.ArgumentTypeError(f"{text!r} has to be numbers, as in 20,-20") from None

    return read


def add_drive(parser: argparse.ArgumentParser) -> None:
    """Add --amplitude and --frequency, which are set so often, and all parameters."""
    for name, text in (("amplitude", "peak to peak"), ("frequency", "of stepping")):
        row = PARAMETERS[name]
        about = f"{text} (default: {row.default:g} {row.unit})"
        option(parser, f"--{name}", row.unit.upper(), about, quantity(row.unit))
    add_parameters(parser)


def add_parameters(parser: argparse.ArgumentParser) -> None:
    """Add --config and --set."""
    text = "ROS parameter file, or the name of one in config/"
    option(parser, "--config", "FILE.yaml", text, Path)
    add_assignments(parser)


def add_assignments(parser: _Adds) -> None:
    """Add --set."""
    text = "set one parameter, may be repeated; --list-parameters shows the names"
    repeated(parser, "--set", "NAME=VALUE", text, dest="assignments")
    text = "print all parameters with their ranges, and exit"
    parser.add_argument("--list-parameters", action=_ListParameters, nargs=0, help=text)


class _ListParameters(argparse.Action):
    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> None:
        from stickslip_ros.physics.laws import LAWS
        from stickslip_ros.physics.model.friction import constants_in_force
        from stickslip_ros.physics.waveforms import WAVEFORMS

        names = {"model": LAWS, "waveform": WAVEFORMS}
        friction = Parameters().friction
        own = constants_in_force(friction)
        for row in PARAMETERS.values():
            usual = f"{row.default:g}" if row.kind in (int, float) else f"{row.default}"
            if row.optional and not row.default:
                filled = getattr(own, row.name, None)
                law = f"{filled:g} ({friction.model})" if filled else ""
                usual = law or "not set"
            span = f"{row.low:g} to {row.high:g}" if row.kind in (int, float) else ""
            about = row.description
            if row.name in names:
                about = f"{about.partition(':')[0]}: {', '.join(names[row.name])}"
            print(f"{row.name:<20} {usual:<16} {span:<21} {row.unit:<6} {about}".rstrip())
        parser.exit()


def parameters_from(args: argparse.Namespace, **overrides: Any) -> Parameters:
    """Return the full set: defaults, then --config, then --set, then overrides that are not None.

    --amplitude and --frequency are overrides, too. Settings without effect are named on stderr.
    Raises ParameterError.
    """
    from stickslip_ros.physics.model.idle import idle_settings  # the table is read without numpy

    values: dict[str, Any] = dict(parse_assignment(text) for text in args.assignments)
    for name in ("amplitude", "frequency"):
        overrides.setdefault(name, getattr(args, name, None))
    values.update({name: value for name, value in overrides.items() if value is not None})
    p = Parameters.of(args.config, **values)
    given = set(values)
    if args.config:
        from stickslip_ros.physics.parameters.bounded_files import read_values

        given.update(read_values(config_file(args.config, UsageError), PARAMETERS))
    if idle := idle_settings(p, given):
        print(f"stickslip: {idle}", file=sys.stderr)
    return p


def report_left_out(command: str, effects: Sequence[str]) -> None:
    """Say on stderr which effects of the parameters a command has left out, if any."""
    if effects:
        print(f"stickslip {command}: leaves out {', '.join(effects)}", file=sys.stderr)


def add_cluster(parser: argparse.ArgumentParser) -> None:
    """Add --cluster."""
    text = "compute on a Dask cluster: local processes, or the address of a scheduler"
    option(parser, "--cluster", "local|tcp://HOST:8786", text)


def yaml_lines(values: Mapping[str, object]) -> str:
    """Return parameters as lines of a YAML file."""
    import yaml

    return yaml.safe_dump(dict(values), sort_keys=False).rstrip()


@contextmanager
def progress_bar(total: int, what: str) -> Iterator[tqdm[Any]]:
    """A progress bar on stderr if the work takes more than a moment; in a pipe a line says what.

    Its clock goes on every second, also while a part of the work takes long.
    """
    from tqdm import tqdm

    in_pipe = not sys.stderr.isatty()
    told = announce_if_slow(what, in_pipes=True) if in_pipe else nullcontext()
    with told, tqdm(total=total, desc=what, disable=in_pipe, delay=0.5) as bar:
        ended = threading.Event()

        def tick() -> None:
            while not ended.wait(1.0):
                bar.refresh()

        ticking = threading.Thread(target=tick, daemon=True)
        if not bar.disable:
            ticking.start()
        try:
            yield bar
        finally:
            ended.set()


@contextmanager
def require_ros() -> Iterator[None]:
    """Raise UsageError where an import in this block fails because there is no ROS."""
    try:
        yield
    except ImportError as error:
        raise UsageError(
            f"needs ROS 2: source it, or pip install 'stickslip_ros[ros]' ({error})"
        ) from None


def add_axis(parser: argparse.ArgumentParser) -> None:
    """Add --axis and --timeout."""
    text = "full name of the axis node (default: %(default)s)"
    option(parser, "--axis", "NODE", text, default=f"/{AXIS_NODE}")
    text = "how long to wait for an answer of the axis (default: 10)"
    option(parser, "--timeout", "S", text, quantity("s"), default=10.0)
