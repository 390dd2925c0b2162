# SPDX-License-Identifier: Apache-2.0
"""``stickslip watch``: the state of an axis, as a live table, or as lines in a pipe."""

from __future__ import annotations

import argparse
import csv
import math
import sys
import time
from collections import deque
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from stickslip_ros.cli.options import add_axis, option, quantity, require_ros
from stickslip_ros.errors import UsageError
from stickslip_ros.reporting import format_si

if TYPE_CHECKING:
    from rich.table import Table

    from stickslip_ros.client import AxisClient

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


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the subcommand."""
    parser.epilog = "In a pipe it prints a line for each period, with times in s, lengths in m."
    add_axis(parser)
    text = "time between updates (default: 0.2)"
    option(parser, "--period", "S", text, quantity("s"), default=0.2)
    text = "end after that time (default: at Ctrl-C)"
    option(parser, "--for", "S", text, quantity("s"), dest="duration", default=math.inf)


def run(args: argparse.Namespace) -> int:
    """Run the subcommand; return the exit code."""
    if not 0.01 <= args.period <= 3600.0:
        raise UsageError(f"--period is {args.period:g} s; it has to lie between 0.01 and 3600")
    with require_ros():
        from stickslip_ros.client import AxisClient
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
    rows.writerow(["time", "state", "position", "velocity", *_STATUS_COLUMNS])
    for now in _ticks(args):
        status = axis.status
        moves = f"{axis.position - zero_of(axis):.9g}", f"{axis.velocity:.6g}"
        said = [status.get(key, "") for key in _STATUS_COLUMNS.values()]
        rows.writerow([f"{now:.3f}", axis.state, *moves, *said])
        sys.stdout.flush()


def zero_of(axis: AxisClient) -> float:
    """Return the position (m) from which commands count, which ``zero`` sets."""
    return float(axis.status.get("zero offset (m)", "0"))


def place_of(axis: AxisClient) -> str:
    """Return the position as commands count it, and the joint's position if it differs."""
    zero = zero_of(axis)
    joint = f" from the zero, joint {format_si(axis.position, 'm', 6)}" if zero else ""
    return f"{format_si(axis.position - zero, 'm', 6)}{joint}"


def _show(axis: AxisClient, args: argparse.Namespace) -> None:
    from rich.live import Live

    positions: deque[float] = deque(maxlen=_SHOWN)
    news: deque[str] = deque(maxlen=_KEPT)
    bars = _bars_for(sys.stdout.encoding)
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


def _bars_for(encoding: str | None) -> str:
    try:
        _BARS.encode(encoding or "ascii")
    except UnicodeEncodeError:
        return _PLAIN_BARS
    return _BARS


def _table(axis: AxisClient, positions: Sequence[float], news: Sequence[str], bars: str) -> Table:
    from rich import box
    from rich.table import Table
    from rich.text import Text

    status = axis.status
    table = Table(title=axis.axis, box=box.SIMPLE, show_header=False)
    rows = [
        ("state", axis.summary),
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
