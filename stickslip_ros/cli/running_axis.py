# SPDX-License-Identifier: Apache-2.0
"""A running axis: ``stickslip send``, one command and its answer; ``watch``, its state.

It is watched as a live table on a terminal, as lines in a pipe.
"""

from __future__ import annotations

import argparse
import contextlib
import csv
import difflib
import math
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from stickslip_ros.base.errors import StickslipError, UsageError
from stickslip_ros.base.reporting import format_si
from stickslip_ros.cli.options import add_axis, flag, option, progress_bar, quantity, require_ros
from stickslip_ros.physics.parameters import PARAMETERS, parse_assignment
from stickslip_ros.physics.parameters.row import read_quantity

if TYPE_CHECKING:
    from rich.table import Table

    from stickslip_ros.axis.command import Command
    from stickslip_ros.ros.client import AxisClient

_OK, _REFUSED = 0, 1
_CYCLE = 1.0  # s: nearly all cycles, in which a stop ends, are shorter
_SWITCH = {"on": True, "true": True, "1": True, "off": False, "false": False, "0": False}
_BARS, _PLAIN_BARS = "▁▂▃▄▅▆▇█", "_.-=^"
#: Positions that the sparkline shows, and refusals and faults that are kept.
_SHOWN, _KEPT = 48, 5
#: Columns in a pipe whose values the status holds
_STATUS_COLUMNS = {
    "steps_done": "steps done",
    "steps_left": "steps left",
    "to_target": "following error (m)",
    "paused": "paused",
    "injected": "injected faults",
    "refused": "refused commands",
    "last_error": "last error",
}


def send_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the subcommand."""
    parser.epilog = (
        "stickslip send --list prints every command with its values. Exit code 1: it was refused, "
        "the axis is in fault, or with --wait: another command or a soft limit ended "
        "the move."
    )
    option(parser, "name", "COMMAND", "such as steps, jog, position, stop")
    option(parser, "values", "VALUE", "such as 100, 5um or NAME=VALUE", nargs="*")
    text = "print all commands with their values, and exit"
    parser.add_argument("--list", action=_ListCommands, nargs=0, help=text)
    add_axis(parser)
    flag(parser, "--all", "of every axis that is found: a command without a value, such as stop")
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


def run_send(args: argparse.Namespace) -> int:
    """Send one command; return the exit code."""
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
    if args.all:
        return _send_to_all(args, command)
    ends = command.name == "stop" or command.turns_off(arguments)
    if args.wait is not None and command.name == "jog" and not ends:
        raise UsageError(
            "a jog does not end: leave out --wait, and stop it by: "
            f"stickslip send --axis {args.axis} stop"
        )
    with contextlib.ExitStack() as waiting:
        if args.wait is not None:  # from here on: ROS takes seconds to load and to find the axis
            waiting.enter_context(progress_bar(0, f"{args.axis}: {args.name}"))
        with require_ros():
            from stickslip_ros.ros.client import AxisClient, AxisFault
        try:
            with AxisClient(args.axis, timeout=args.timeout, listeners=args.listeners) as axis:
                axis.send(command.name, *arguments)
                if args.wait is not None:
                    axis.wait(args.wait)
                elif ends:
                    with contextlib.suppress(TimeoutError, AxisFault):
                        axis.wait(_CYCLE)
                waiting.close()
                last = ", it ends with its cycle" if ends and axis.moving else ""
                setting = _setting(command, arguments, axis)
                print(f"{setting}{axis.summary}, at {place_of(axis)}{_ends_met(axis)}{last}")
                if args.wait is not None and (by := axis.ended_by):
                    raise CommandRefused(f"{command.name} was ended by a limit: {by}")
        except (CommandRefused, AxisFault) as error:
            print(f"stickslip send: {error}", file=sys.stderr)
            return _REFUSED
        except (TimeoutError, ValueError) as error:
            raise UsageError(str(error)) from None
    return _OK


def _send_to_all(args: argparse.Namespace, command: Command) -> int:
    if command.arguments != () or args.wait is not None:
        cure = f"send {command.name} to each axis, by --axis NODE"
        raise UsageError(f"--all is for commands without a value and without --wait; {cure}")
    with require_ros():
        from stickslip_ros.ros.client.axis_client import command_all
    with progress_bar(0, f"every axis: {command.name}"):
        reasons = command_all(command, args.timeout)
    if not reasons:
        raise UsageError("no axis is found: is axis_node running in this ROS_DOMAIN_ID?")
    for axis, reason in sorted(reasons.items()):
        said = f"stickslip send: {axis}: {reason}" if reason else f"{axis}: {command.name} done"
        print(said, file=sys.stderr if reason else sys.stdout)
    return _REFUSED if any(reasons.values()) else _OK


def _setting(command: Command, arguments: Sequence[Any], axis: AxisClient) -> str:
    """Return the values that a command has set, such as the frequency; "" if it sets none."""
    value = axis.status.get(f"{command.name} ({command.unit})")
    found: Mapping[str, Any] = {command.name: float(value)} if value else {}
    if arguments and isinstance(arguments[0], Mapping):
        found = arguments[0]
    units = {command.name: command.unit, **{name: row.unit for name, row in PARAMETERS.items()}}
    texts = {
        name: format_si(one, units[name]) if isinstance(one, float) else one
        for name, one in found.items()
    }
    return "".join(f"{name} {'none' if text == '' else text}, " for name, text in texts.items())


def _ends_met(axis: AxisClient) -> str:
    """Return which limits hold the runner or were hit, if there are such."""
    met = _limits_met(axis)
    ends = [end for end in ("low", "high") if f"travel_{end}" in met]
    words = [f"the {' and the '.join(ends)} end of the travel"] if ends else []
    words += [limit for limit in met if limit.startswith("soft")]
    return f", against {' and '.join(words)}" if words else ""


def _limits_met(axis: AxisClient) -> list[str]:
    held = axis.status["held at"]
    return list(dict.fromkeys([*([f"travel_{held}"] if held else []), *axis.limits_hit]))


# -- the values of a command line, by the type of the command's message


def form_of(command: Command) -> str:
    """Return how a command is written, for the help."""
    form, _, _ = _values()[command.type]
    return f"{command.name} {form or command.unit}".strip()


def _read(command: Command, texts: Sequence[str]) -> tuple[Any, ...]:
    """Return the arguments of a command; UsageError with how to write them."""
    _, wanted, read = _values()[command.type]
    try:
        return read(command.unit, *texts)
    except (ValueError, KeyError, TypeError) as error:  # TypeError: another number of texts
        if isinstance(error, StickslipError):
            raise
        unit = f" in {command.unit}" if command.unit else ""
        given = " ".join(texts) or "none"
        raise UsageError(f"{command.name} takes {wanted}{unit}; given: {given}") from None


def _points(_: str, first: str, *others: str) -> tuple[Any, ...]:
    pairs = [text.split(":") for text in (first, *others)]
    return ([(read_quantity(t, "s"), read_quantity(x, "m")) for t, x in pairs],)


def _set_point(_: str, joint: str, interface: str, value: str) -> tuple[Any, ...]:
    return joint, interface, read_quantity(value, {"position": "m", "velocity": "m/s"}[interface])


def _assignments(_: str, first: str, *others: str) -> tuple[Any, ...]:
    return (dict(parse_assignment(text) for text in (first, *others)),)


def _values() -> Mapping[str, tuple[str, str, Callable[..., tuple[Any, ...]]]]:
    """Return form, description and reader of the values of each kind of command.

    A reader gets the unit of the command and the texts; ValueError, KeyError or TypeError for wrong
    ones.
    """
    from stickslip_ros.axis import command as of

    point = "JOINT position|velocity VALUE"
    number = ("", "a number", lambda unit, text: (read_quantity(text, unit),))
    return {
        of.INT32: ("N", "a whole number", lambda _, text: (int(text),)),
        of.FLOAT64: number,
        of.WRENCH: number,
        of.SET_BOOL: ("on|off", "on or off", lambda _, text: (_SWITCH[text.lower()],)),
        of.TRIGGER: ("", "no value", lambda _: ()),
        of.TRAJECTORY: ("TIME:POSITION ...", "points TIME:POSITION, such as 0.5s:1um", _points),
        of.JOINT_STATE: (point, point, _set_point),
        of.SET_PARAMETERS: ("NAME=VALUE ...", "NAME=VALUE, such as preload=1.0", _assignments),
    }


# -- watch


def watch_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the subcommand."""
    parser.epilog = "In a pipe it prints a line for each period, with times in s, lengths in m."
    add_axis(parser)
    text = "time between updates (default: 0.2)"
    option(parser, "--period", "S", text, quantity("s"), default=0.2)
    text = "end after that time (default: at Ctrl-C)"
    option(parser, "--for", "S", text, quantity("s"), dest="duration", default=math.inf)


def run_watch(args: argparse.Namespace) -> int:
    """Show the state of an axis; return the exit code."""
    if not 0.01 <= args.period <= 3600.0:
        raise UsageError(f"--period is {args.period:g} s; it has to lie between 0.01 and 3600")
    with require_ros():
        from stickslip_ros.ros.client import AxisClient
    try:
        with AxisClient(args.axis, timeout=args.timeout) as axis:
            if sys.stdout.isatty():
                _show(axis, args)
            else:
                _print(axis, args)
    except TimeoutError as error:
        raise UsageError(str(error)) from None
    except KeyboardInterrupt:  # the usual end
        return 0
    return 0


def sparkline(values: Sequence[float], bars: str = _BARS) -> str:
    """Return values as a row of bars, the least as the lowest and the greatest as the highest.

    >>> sparkline([0.0, 1.0, 2.0, 7.0])
    '▁▂▃█'
    """
    if not values:
        return ""
    low, span = min(values), max(values) - min(values)
    top = len(bars) - 1
    return "".join(bars[round(top * (v - low) / span) if span > 0.0 else 0] for v in values)


def _ticks(args: argparse.Namespace) -> Iterator[float]:
    """Yield the time (s) since the start, once a period, until the duration is over."""
    start = time.monotonic()
    for k in range(sys.maxsize):
        due = k * args.period
        if due > args.duration:
            return
        time.sleep(max(0.0, start + due - time.monotonic()))
        yield time.monotonic() - start


def _print(axis: AxisClient, args: argparse.Namespace) -> None:
    rows = csv.writer(sys.stdout, lineterminator="\n")
    rows.writerow(["time", "state", "position", "velocity", *_STATUS_COLUMNS, "against"])
    for now in _ticks(args):
        status = axis.status
        moves = f"{axis.position:.9g}", f"{axis.velocity:.6g}"
        said = [status.get(key, "") for key in _STATUS_COLUMNS.values()]
        rows.writerow([f"{now:.3f}", axis.state, *moves, *said, " ".join(_limits_met(axis))])
        sys.stdout.flush()


def place_of(axis: AxisClient) -> str:
    """Return the position as the sensor reads it and commands count it."""
    x = axis.position
    return "a position that no sensor reads" if math.isnan(x) else format_si(x, "m", 6)


def _show(axis: AxisClient, args: argparse.Namespace) -> None:
    from rich.live import Live

    positions: deque[float] = deque(maxlen=_SHOWN)
    news: deque[str] = deque(maxlen=_KEPT)
    bars = _BARS
    try:
        _BARS.encode(sys.stdout.encoding or "ascii")
    except UnicodeEncodeError:
        bars = _PLAIN_BARS
    seen = axis.status["refused commands"], axis.status["last error"]
    with Live(auto_refresh=False) as live:
        for now in _ticks(args):
            positions.append(axis.position)
            status = axis.status
            refusal = status["refused commands"], status["last error"]
            if refusal != seen:
                news.append(f"{now:.1f} s: {refusal[1]}")
                seen = refusal
            live.update(_table(axis, positions, news, bars), refresh=True)


def _table(axis: AxisClient, positions: Sequence[float], news: Sequence[str], bars: str) -> Table:
    from rich import box
    from rich.table import Table
    from rich.text import Text

    status = axis.status
    table = Table(title=axis.axis, box=box.SIMPLE, show_header=False)
    rows = [
        ("state", f"{axis.summary}{_ends_met(axis)}"),
        ("position", place_of(axis)),
        ("", sparkline(positions, bars)),
        ("velocity", f"{1e6 * axis.velocity:.3f} µm/s"),
        ("drive", f"{float(status['amplitude (V)']):g} V, {float(status['frequency (Hz)']):g} Hz"),
        ("limits hit", status["limits hit"]),
        ("refused", status["refused commands"]),
        *(("", line) for line in news),
    ]
    for name, value in rows:
        style = "red" if name == "state" and axis.state == "fault" else ""
        table.add_row(name, Text(value, style=style))
    return table
