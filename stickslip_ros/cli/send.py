# SPDX-License-Identifier: Apache-2.0
"""``stickslip send``: one command to a running axis, and its answer."""

from __future__ import annotations

import argparse
import contextlib
import difflib
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from stickslip_ros.cli.options import add_axis, option, progress_bar, quantity, require_ros
from stickslip_ros.cli.watch import place_of
from stickslip_ros.errors import StickslipError, UsageError
from stickslip_ros.parameters import PARAMETERS, parse_assignment
from stickslip_ros.parameters.row import read_quantity
from stickslip_ros.reporting import format_si

if TYPE_CHECKING:
    from stickslip_ros.axis.command import Command
    from stickslip_ros.client import AxisClient

_OK, _REFUSED = 0, 1
_CYCLE = 1.0  # s: nearly all cycles, in which a stop ends, are shorter
_SWITCH = {"on": True, "true": True, "1": True, "off": False, "false": False, "0": False}


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the subcommand."""
    parser.epilog = (
        "stickslip send --list prints every command with its values. Exit code 1: it was refused, "
        "the axis is in fault, or with --wait: another command ended the move."
    )
    option(parser, "name", "COMMAND", "such as steps, jog, position, stop")
    option(parser, "values", "VALUE", "such as 100, 5um or NAME=VALUE", nargs="*")
    text = "print all commands with their values, and exit"
    parser.add_argument("--list", action=_ListCommands, nargs=0, help=text)
    add_axis(parser)
    text = "wait until the move has ended or the target is reached (default: 60 s at most)"
    option(parser, "--wait", "S", text, quantity("s"), nargs="?", const=60.0)
    text = "send when so many nodes listen: 2 for the axis and a recorder (default: 1)"
    option(parser, "--listeners", "N", text, int, default=1)


class _ListCommands(argparse.Action):
    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> None:
        from stickslip_ros.axis.commands import COMMANDS

        for command in COMMANDS.values():
            print(f"{form_of(command):<44} {command.meaning}")
        parser.exit()


def run(args: argparse.Namespace) -> int:
    """Run the subcommand; return the exit code."""
    from stickslip_ros.axis.commands import COMMANDS
    from stickslip_ros.axis.events import CommandRefused

    if args.name not in COMMANDS:
        near = difflib.get_close_matches(args.name, COMMANDS, 1)
        hint = f"did you mean {near[0]!r}?" if near else f"there are {', '.join(COMMANDS)}"
        if args.name in PARAMETERS:
            hint = f"it is a parameter: stickslip send parameters {args.name}=VALUE"
        raise UsageError(f"there is no command {args.name!r}; {hint}")
    command = COMMANDS[args.name]
    arguments = _read(command, args.values)
    ends = command.name == "stop" or command.turns_off(arguments)
    if args.wait is not None and command.name == "jog" and not ends:
        raise UsageError(
            "a jog does not end: leave out --wait, and stop it by: stickslip send stop"
        )
    with require_ros():
        from stickslip_ros.client import AxisClient, AxisFault

    try:
        with AxisClient(args.axis, timeout=args.timeout, listeners=args.listeners) as axis:
            axis.send(command.name, *arguments)
            if args.wait is not None:
                with progress_bar(0, f"{args.axis}: {args.name}"):
                    axis.wait(args.wait)
            elif ends:
                with contextlib.suppress(TimeoutError, AxisFault):
                    axis.wait(_CYCLE)
            last = ", it ends with its cycle" if ends and axis.moving else ""
            print(f"{_setting(command, axis)}{axis.summary}, at {place_of(axis)}{last}")
            if args.wait is not None and axis.ended_by:
                raise CommandRefused(
                    f"{command.name} was ended by another command: {axis.ended_by}"
                )
    except (CommandRefused, AxisFault) as error:
        print(f"stickslip send: {error}", file=sys.stderr)
        return _REFUSED
    except (TimeoutError, ValueError) as error:
        raise UsageError(str(error)) from None
    return _OK


def _setting(command: Command, axis: AxisClient) -> str:
    """Return the value that a command has set, such as the frequency; "" if it sets none."""
    value = axis.status.get(f"{command.name} ({command.unit})")
    return f"{command.name} {format_si(float(value), command.unit)}, " if value else ""


# -- the values of a command line, by the type of the command's message

#: Reads the texts and the unit of a command; ValueError or KeyError for wrong texts
_Read = Callable[[Sequence[str], str], tuple[Any, ...]]


def form_of(command: Command) -> str:
    """Return how a command is written, for the help."""
    form, _, _ = _values()[command.type]
    return f"{command.name} {form or command.unit}".strip()


def _read(command: Command, texts: Sequence[str]) -> tuple[Any, ...]:
    """Return the arguments of a command; UsageError with how to write them."""
    _, wanted, read = _values()[command.type]
    try:
        return read(texts, command.unit)
    except (ValueError, KeyError) as error:
        if isinstance(error, StickslipError):
            raise
        unit = f" in {command.unit}" if command.unit else ""
        given = " ".join(texts) or "none"
        raise UsageError(f"{command.name} takes {wanted}{unit}; given: {given}") from None


def _one(read: Callable[[str, str], Any]) -> _Read:
    def read_one(texts: Sequence[str], unit: str) -> tuple[Any, ...]:
        (text,) = texts
        return (read(text, unit),)

    return read_one


def _none(texts: Sequence[str], _: str) -> tuple[Any, ...]:
    () = texts
    return ()


def _points(texts: Sequence[str], _: str) -> tuple[Any, ...]:
    pairs = [text.split(":") for text in texts]
    points = [(read_quantity(t, "s"), read_quantity(x, "m")) for t, x in pairs]
    if not points:
        raise ValueError
    return (points,)


def _set_point(texts: Sequence[str], _: str) -> tuple[Any, ...]:
    joint, interface, value = texts
    if interface not in ("position", "velocity"):
        raise ValueError
    return joint, interface, float(value)


def _assignments(texts: Sequence[str], _: str) -> tuple[Any, ...]:
    if not texts:
        raise ValueError
    return (dict(parse_assignment(text) for text in texts),)


def _values() -> Mapping[str, tuple[str, str, _Read]]:
    """Return form, description and reader of the values of each kind of command."""
    from stickslip_ros.axis import command as of

    point, number = "JOINT position|velocity VALUE", ("", "a number", _one(read_quantity))
    return {
        of.INT32: ("N", "a whole number", _one(lambda text, _: int(text))),
        of.FLOAT64: number,
        of.WRENCH: number,
        of.SET_BOOL: ("on|off", "on or off", _one(lambda text, _: _SWITCH[text.lower()])),
        of.TRIGGER: ("", "no value", _none),
        of.TRAJECTORY: ("TIME:POSITION ...", "points TIME:POSITION, such as 0.5s:1um", _points),
        of.JOINT_STATE: (point, point, _set_point),
        of.SET_PARAMETERS: ("NAME=VALUE ...", "NAME=VALUE, such as preload=1.0", _assignments),
    }
