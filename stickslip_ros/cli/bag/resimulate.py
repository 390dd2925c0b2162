# SPDX-License-Identifier: Apache-2.0
"""``stickslip bag resimulate``: simulate a recorded axis again; compare, or change parameters."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from stickslip_ros.cli.options import add_outputs, option, print_result, progress_bar, repeated
from stickslip_ros.parameters import parse_assignment

_DIFFERENT = 1


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the action."""
    parser.description = (
        "Rebuilds the run from the parameters and commands in the bag. The same version on the "
        "same machine gives every recorded state again, bit for bit; exit code 1 if it does not. "
        "With --set it answers 'what if': the same commands, other parameters."
    )
    option(parser, "bag", "BAG", "folder of a bag, or one file of it", Path)
    repeated(parser, "--set", "NAME=VALUE", "change a parameter")
    option(parser, "--out", "DIR", "write the computed run as a new bag", Path)
    add_outputs(parser)


def run(args: argparse.Namespace) -> int:
    """Run the subcommand; return the exit code."""
    from stickslip_ros.axis.command import JOINT_STATE
    from stickslip_ros.compiled import report_compilation
    from stickslip_ros.recordings import open_bag, recorded_runs, resimulate

    changes = dict(parse_assignment(text) for text in args.set)
    with open_bag(args.bag) as bag, report_compilation():
        states = sum(
            bag.counts[name] for name, one in bag.topics.items() if one.type == JOINT_STATE
        )
        # An axis may have lived long before it was recorded.
        lived = [(run.end_ns or bag.end_ns) - run.start_ns for run in recorded_runs(bag)]
        motion = f"computing {1e-9 * sum(lived):.0f} s of motion"
        with progress_bar(states, motion) as bar:
            runs = resimulate(bag, changes, args.out, bar.update)
    reports = [one.as_dict() for one in runs]
    texts = [_text(report, bool(changes)) for report in reports]
    texts += [f"written to {args.out}"] if args.out else []
    content = {"bag": str(args.bag), "changes": changes, "runs": reports}
    print_result(args, content, lambda: "\n\n".join(texts))
    return 0 if changes or all(one.bit_for_bit for one in runs) else _DIFFERENT


def _text(report: dict[str, Any], changed: bool) -> str:
    lines = [
        f"{report['axis']}: {report['commands']} commands, {report['states']} states "
        f"over {report['duration']:.3f} s"
    ]
    if report["version"] != report["this_version"]:
        lines.append(
            f"recorded by version {report['version'] or '?'}, run again by {report['this_version']}"
        )
    lines += _model_lines(report)
    lines += [f"left out: {text}" for text in report["left_out"]]
    if report["bit_for_bit"]:
        lines.append("every recorded state came out again, bit for bit")
        return "\n".join(lines)
    against = "the run as recorded" if changed else "what was recorded"
    lines.append(f"{'largest difference to ' + against:<44}{'at (s)':>12}{'unequal':>20}")
    for name, d in report["differences"].items():
        at = "" if d["at"] is None else f"{d['at']:.6f}"
        lines.append(
            f"  {name:<26}{d['largest']:>12.3e} {d['unit']:<4}{at:>12}"
            f"{d['unequal']:>10} of {d['values']}"
        )
    return "\n".join(lines)


def _model_lines(report: dict[str, Any]) -> list[str]:
    """Say why a run of another model may come out otherwise; nothing if it may not."""
    recorded, this = report["model_version"], report["this_model_version"]
    if recorded > this:
        return [f"recorded with model {recorded}, this is model {this}: install a newer version"]
    return [
        f"recorded with model {recorded}, this is model {this}: differs by at most "
        f"{change['largest']} (since model {change['version']}, {change['what']})"
        for change in report["model_changes"]
    ]
