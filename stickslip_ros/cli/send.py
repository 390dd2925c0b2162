# SPDX-License-Identifier: Apache-2.0
"""``stickslip send``: one command to a running axis, and its answer."""

from __future__ import annotations

import argparse
import difflib
import sys
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from stickslip_ros.cli.options import UsageError, add_axis, needing_ros, option, quantity
from stickslip_ros.parameters import parse_assignment
from stickslip_ros.parameters.quantity import read_quantity
from stickslip_ros.reporting import shown

if TYPE_CHECKING:
    from stickslip_ros.axis.commands import Command
    from stickslip_ros.client import AxisClient

_OK, _REFUSED = 0, 1
_SWITCH = {"on": True, "true": True, "1": True, "off": False, "false": False, "0": False}


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the subcommand."""
    parser.epilog = "stickslip send --list prints every command with its values."
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
        raise UsageError(f"there is no command {args.name!r}; {hint}")
    command = COMMANDS[args.name]
    arguments = _readers()[command.type](command, args.values)
    with needing_ros():
        from stickslip_ros.client import AxisClient, AxisFault

    try:
        with AxisClient(args.axis, timeout=args.timeout, listeners=args.listeners) as axis:
            _send(axis, command, arguments)
            if args.wait is not None:
                axis.wait(args.wait)
            print(_state(axis))
    except (CommandRefused, AxisFault) as error:
        print(f"stickslip send: {error}", file=sys.stderr)
        return _REFUSED
    except (TimeoutError, ValueError) as error:
        raise UsageError(str(error)) from None
    return _OK


def _send(axis: AxisClient, command: Command, arguments: Sequence[Any]) -> None:
    from stickslip_ros.axis.commands import SET_PARAMETERS, TRAJECTORY

    if command.type == TRAJECTORY:
        axis.follow(arguments[0])
    elif command.type == SET_PARAMETERS:
        axis.set_parameters(**arguments[0])
    elif command.name == "jog":
        axis.jog(arguments[0])  # it knows that a jog has no end
    else:
        axis.send(command.name, *arguments)


def _state(axis: AxisClient) -> str:
    status = axis.status
    done, left = status["steps done"], status["steps left"]
    return f"{axis.state}, {done} steps done, {left} left, at {shown(axis.position, 'm', 6)}"


# -- the values of a command line, by the type of the command's message


def form_of(command: Command) -> str:
    """Return how a command is written, for the help."""
    from stickslip_ros.axis.commands import (
        INT32,
        JOINT_STATE,
        SET_BOOL,
        SET_PARAMETERS,
        TRAJECTORY,
        TRIGGER,
    )

    values = {
        INT32: "N", TRIGGER: "", SET_BOOL: "on|off", TRAJECTORY: "SECONDS:METRES ...",
        JOINT_STATE: "JOINT position|velocity VALUE", SET_PARAMETERS: "NAME=VALUE ...",
    }.get(command.type, command.unit)  # fmt: skip
    return f"{command.name} {values}".strip()


def _none(command: Command, texts: Sequence[str]) -> tuple[Any, ...]:
    if texts:
        raise UsageError(f"{command.name} takes no value, but there is {texts[0]!r}; leave it out")
    return ()


def _one(kind: Callable[[str, str], Any], form: str) -> Callable[..., tuple[Any, ...]]:
    def read(command: Command, texts: Sequence[str]) -> tuple[Any, ...]:
        try:
            (text,) = texts
            return (kind(text, command.unit),)
        except (ValueError, KeyError):
            given = " ".join(texts) or "none"
            unit = f" in {command.unit}" if command.unit else ""
            raise UsageError(f"{command.name} takes {form}{unit}; given: {given}") from None

    return read


def _points(command: Command, texts: Sequence[str]) -> tuple[Any, ...]:
    try:
        points = [tuple(map(float, text.split(":"))) for text in texts]
        if not points or any(len(point) != 2 for point in points):
            raise ValueError
    except ValueError:
        raise UsageError(
            f"{command.name} takes points SECONDS:METRES, such as 0.5:1e-6; given: "
            f"{' '.join(texts) or 'none'}"
        ) from None
    return (points,)


def _set_point(command: Command, texts: Sequence[str]) -> tuple[Any, ...]:
    try:
        joint, interface, value = texts
        if interface not in ("position", "velocity"):
            raise ValueError
        return joint, interface, float(value)
    except ValueError:
        given = " ".join(texts) or "none"
        raise UsageError(
            f"{command.name} takes JOINT position|velocity VALUE; given: {given}"
        ) from None


def _assignments(command: Command, texts: Sequence[str]) -> tuple[Any, ...]:
    if not texts:
        raise UsageError(f"{command.name} takes NAME=VALUE, such as preload=1.0; given: none")
    return (dict(parse_assignment(text) for text in texts),)


def _readers() -> dict[str, Callable[[Command, Sequence[str]], tuple[Any, ...]]]:
    """Return what reads the values of commands, by the type of their message."""
    from stickslip_ros.axis import commands as of

    return {
        of.INT32: _one(lambda text, _: int(text), "a whole number"),
        of.FLOAT64: _one(read_quantity, "a number"),
        of.WRENCH: _one(read_quantity, "a number"),
        of.SET_BOOL: _one(lambda text, _: _SWITCH[text.lower()], "on or off"),
        of.TRIGGER: _none,
        of.TRAJECTORY: _points,
        of.JOINT_STATE: _set_point,
        of.SET_PARAMETERS: _assignments,
    }
