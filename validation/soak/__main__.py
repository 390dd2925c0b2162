# SPDX-License-Identifier: Apache-2.0
"""``make soak``: node, recorder and random commands for hours, with a report page."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stickslip_ros.base.errors import UsageError
from stickslip_ros.base.files import WriteError, write_text
from stickslip_ros.base.reporting.page import page, plot_parts
from stickslip_ros.cli.command_line import Parser, finish
from stickslip_ros.cli.options import progress_bar, require_ros

if TYPE_CHECKING:
    from validation.soak.run import Soaked

_FINDING = 1
_COLOURS = {"axis": "#1f4e9c", "recorder": "#c0392b"}


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    parser = Parser(
        prog="make soak",
        description="Runs an axis and a recorder under random commands and parameters. Watches "
        "memory, open files and deadlines; at the end looks for gaps in the bag and computes the "
        "run again, bit for bit. Missed deadlines are reported, but not counted as "
        "findings, because they depend on the machine. Ctrl-C ends it early, "
        "with a report of what there is.",
        epilog="Exit code 1 if anything was found.",
    )
    parser.add_argument("--hours", type=float, required=True, metavar="H", help="how long")
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("soak"),
        metavar="DIR",
        help="new folder for report, bag and logs (default: soak)",
    )
    parser.add_argument("--seed", type=int, default=0, help="of the commands (default: 0)")
    parser.add_argument(
        "--params-file",
        type=Path,
        metavar="FILE",
        help="parameters of the axis, as axis_node takes them (default: the built-in ones)",
    )
    parser.add_argument("--json", action="store_true", help="print soak.json")
    parser.set_defaults(run=run)
    return parser


def run(args: argparse.Namespace) -> int:
    """Run axis and recorder; return the exit code."""
    if not 0.0 < args.hours < math.inf:
        raise UsageError(f"--hours is {args.hours:g}; it has to be above 0")
    if not Path("/proc/self/statm").exists():
        raise UsageError("needs /proc to watch the processes: run it on Linux")
    with require_ros():
        from stickslip_ros.base.child_process import choose_domain
        from validation.soak.run import soak
    try:
        args.out.mkdir()
    except OSError as error:
        raise WriteError(args.out, error) from None
    choose_domain()
    seconds = 3600.0 * args.hours
    with progress_bar(round(seconds), "seconds") as bar:
        found = soak(args.out.absolute(), seconds, args.seed, bar.update, args.params_file)
    text = json.dumps(found.as_dict(), indent=1)
    write_text(args.out / "soak.json", text + "\n")
    write_text(args.out / "index.html", _page(found))
    print(text if args.json else "\n".join(_lines(found, args.out)))
    return _FINDING if found.findings else 0


def _lines(found: Soaked, out: Path) -> list[str]:
    return [
        *(f"{name:<18} {value}" for name, value in _facts(found).items()),
        *(f"finding: {text}" for text in found.findings or ["none"]),
        f"report: {out / 'index.html'}",
    ]


def _facts(found: Soaked) -> dict[str, str]:
    """Return the result in words."""
    took = f"{found.seconds / 3600.0:.3g} h" if found.seconds > 600 else f"{found.seconds:.1f} s"
    again = {True: "yes", False: "no", None: "not tried"}[found.bit_for_bit]
    facts = {
        "time": took + (", interrupted" if found.interrupted else ""),
        "commands": f"{found.sent.total()}, of these {found.refused.total()} refused",
        "faults": f"{found.faults}",
        "slowest answer": f"{found.slowest:.3g} s",
        "messages": f"{found.messages}, lost {found.lost}, gaps {found.gaps}",
        "states run again": f"{found.states}, bit for bit: {again}",
    }
    if not found.samples:
        return facts
    last = found.samples[-1]
    facts["missed deadlines"] = f"{last.missed}"
    for name, size in last.memory.items():
        growth = found.growth(name)
        grown = "too short to judge growth" if growth is None else f"{growth:+.2f} MB in 2nd half"
        facts[f"{name} memory"] = f"{size:.1f} MB, {grown}"
        facts[f"{name} descriptors"] = f"{last.descriptors[name]}"
    return facts


def _page(found: Soaked) -> str:
    figures = {
        "memory": _figure(
            found, "MB", {name: [s.memory[name] for s in found.samples] for name in _COLOURS}
        ),
        "deadlines": _figure(
            found, "missed deadlines", {"axis": [s.missed for s in found.samples]}
        ),
    }
    return page(
        Path(__file__).with_name("soak.html"),
        facts=_facts(found),
        findings=found.findings,
        seed=found.seed,
        commands=[(name, n, found.refused[name]) for name, n in sorted(found.sent.items())],
        **plot_parts(figures),
    )


def _figure(found: Soaked, unit: str, lines: dict[str, Any]) -> dict[str, Any]:
    times = [round(sample.time, 1) for sample in found.samples]
    return {
        "data": [
            {
                "type": "scatter",
                "mode": "lines",
                "x": times,
                "y": values,
                "name": name,
                "line": {"color": _COLOURS[name], "width": 1.5},
            }
            for name, values in lines.items()
        ],
        "layout": {
            "height": 300,
            "margin": {"l": 60, "r": 10, "t": 30, "b": 45},
            "xaxis": {"title": {"text": "time (s)"}},
            "yaxis": {"title": {"text": unit}},
        },
    }


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return its exit code."""
    return finish("soak", parser().parse_args(argv))


if __name__ == "__main__":
    sys.exit(main())
