# SPDX-License-Identifier: Apache-2.0
"""``stickslip bag``: actions on recordings."""

from __future__ import annotations

import argparse
import sys
from dataclasses import asdict
from datetime import UTC, datetime
from importlib import import_module
from pathlib import Path
from typing import Any

from stickslip_ros.base.errors import UsageError, printable
from stickslip_ros.cli.command_line import add_commands
from stickslip_ros.cli.options import (
    flag,
    option,
    progress_bar,
    quantity,
    repeated,
    require_ros,
)
from stickslip_ros.cli.outputs import add_outputs, check_outputs, put_out
from stickslip_ros.physics.parameters import PARAMETERS, parse_assignment

#: In the order of the help.
ACTIONS = {
    "info": "topics, times, sizes, QoS and the parameters of the recorded axis",
    "record": "record topics until Ctrl-C (default: all topics of every axis)",
    "play": "publish the messages of a bag at their times, with their recorded QoS",
    "resimulate": "compute a recorded run again and compare every state with the recorded one",
    "recover": "make a good bag from an unfinished or damaged one",
    "export": "write the messages as tables, CSV or Parquet",
}
#: A run that came out otherwise; an old bag of which something is missing or cannot be vouched for.
_DIFFERENT, _DOUBTFUL = 1, 3
#: What is in the arguments of record and play that is no parameter of their nodes.
_NO_PARAMETERS = ("command", "action", "run", "remap")


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the actions."""
    add_commands(parser, "action", ACTIONS, ACTIONS, lambda _: sys.modules[__name__])


def _add_bag(parser: argparse.ArgumentParser) -> None:
    option(parser, "bag", "BAG", "folder of a bag, or one file of it", Path)


# -- info


def info_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    _add_bag(parser)
    option(parser, "--joint", "NAME", "joint to draw (default: the only slider)")
    add_outputs(parser, "the position over time", "the topics")


def run_info(args: argparse.Namespace) -> int:
    """Describe a recording."""
    from stickslip_ros.recordings import describe, open_bag

    check_outputs(args)
    with open_bag(args.bag) as bag:
        found = describe(bag)
    draw = None
    if args.plot or args.report:
        from stickslip_ros.measurement.bags.load_motion import load_motion

        draw = load_motion(args.bag, joint=args.joint).motion.plot
    names = ("name", "type", "messages")
    table = names, [[_printable(topic[name]) for name in names] for topic in found["topics"]]
    put_out(
        args, found, lambda: "\n".join(_description(found)), f"Recording {args.bag}", table, draw
    )
    return 0


def _description(found: dict[str, Any]) -> list[str]:
    from stickslip_ros.axis.events import value_text

    found = _printable(found)
    apart = "".join(f"; {text}" for text in found["warnings"] if text.endswith("left out"))
    chunks = ", ".join(name or "none" for name in found["compression"]) or "none"
    packed = f", each {found['packed']} packed as a whole" if found["packed"] else ""
    files = f"{len(found['files'])} file{'s' * (len(found['files']) > 1)}"
    lines = [
        f"bag          {found['bag']}",
        f"size         {_bytes(found['size'])} in {files}",
        f"compression  {chunks}{packed}",
        f"start        {_date(found['start_ns'])}",
        f"end          {_date(found['end_ns'])}",
        f"duration     {found['duration']:.3f} s",
        f"messages     {found['messages']}{apart}",
        f"recorded by  {', '.join(found['written_by'])}"
        f"{', ROS ' + found['ros_distro'] if found['ros_distro'] else ''}",
    ]
    lines += [f"{key:<12} {text}" for key, text in found["custom_data"].items()]
    lines += ["", "topics"]
    width = max((len(topic["name"]) for topic in found["topics"]), default=0)
    for topic in found["topics"]:
        kinds = {f"{one['reliability']}, {one['durability']}" for one in topic["offered_qos"]}
        said = "; ".join(sorted(kinds)) if topic["messages"] else "no messages"
        lines.append(f"  {topic['name']:<{width}} {topic['messages']:>9}  {topic['type']}  {said}")
        if topic["undecodable"]:
            lines.append(f"    {topic['undecodable']}")
    for name, parameters in found["axes"].items():
        texts = {key: value_text(value) for key, value in parameters.items()}
        own = {key: text for key, text in texts.items() if not _is_default(key, text)}
        rest = len(parameters) - len(own)
        lines += ["", f"axis of {name}; {rest} more parameters at their defaults, see --json"]
        lines += [f"  {key:<24} {text}".rstrip() for key, text in own.items()]
    return lines


def _printable(value: Any) -> Any:
    """Return plain values with all texts printable; most of those in a bag are a stranger's."""
    if isinstance(value, dict):
        return {_printable(key): _printable(one) for key, one in value.items()}
    if isinstance(value, list):
        return [_printable(one) for one in value]
    return printable(value) if isinstance(value, str) else value


def _is_default(name: str, text: str) -> bool:
    """Return whether a recorded value of a parameter is the default of this version."""
    from stickslip_ros.axis.events import value_text

    row = PARAMETERS.get(name)
    return row is not None and text == value_text(row.check(row.default))


def _date(ns: int) -> str:
    """Return a time with all its digits, which a float would not keep."""
    try:
        date = datetime.fromtimestamp(ns // 1_000_000_000, UTC)
    except (OverflowError, ValueError, OSError):
        return f"{ns} ns"
    return f"{date:%Y-%m-%d %H:%M:%S}.{ns % 1_000_000_000:09d} UTC"


def _bytes(count: float) -> str:
    for unit in ("B", "kB", "MB"):
        if count < 1000:
            return f"{count:.4g} {unit}"
        count /= 1000
    return f"{count:.4g} GB"


# -- record and play


def record_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.epilog = (
        "Also as a node, ros2 run stickslip_ros recorder_node, with the same options as "
        "parameters and the services ~/start, ~/stop and ~/split."
    )
    option(parser, "topics", "TOPIC", "topics to record", nargs="*")
    option(parser, "--regex", "R", "also every topic whose full name matches")
    text = "axis node (default: every axis that is found)"
    option(parser, "--axis", "NODE", text, action="append", dest="axes")
    text = "new folder (default: stickslip_<date>-<time>)"
    option(parser, "--out", "DIR", text, dest="output")
    option(parser, "--compression", "none|lz4|zstd", "compress chunks (default: none)")
    option(parser, "--max-size", "MB", "size for a new file (default: never)", float)
    option(parser, "--max-duration", "S", "time for a new file (default: never)", quantity("s"))
    text = "write the bag to the disk only at the end; a power cut may lose all of it"
    parser.add_argument("--no-fsync", dest="fsync", action="store_false", default=None, help=text)
    text = "time between status lines (default: 10)"
    option(parser, "--status", "S", text, quantity("s"), dest="status_period")


def run_record(args: argparse.Namespace) -> int:
    """Record topics until stopped."""
    return _run_node(args, "recorder_node", "RecorderNode")


def play_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.epilog = (
        "Also as a node, ros2 run stickslip_ros replay_node, with the same options as parameters."
    )
    option(parser, "bag", "BAG", "folder of a bag, or one of its files")
    option(parser, "--rate", "X", "speed (default: 1)", float)
    flag(parser, "--loop", "repeat without end", default=None)
    text = "publish /clock (default rate: 100 Hz)"
    option(parser, "--clock", "HZ", text, quantity("Hz"), nargs="?", const=100.0)
    option(parser, "--start", "S", "skip this time at the beginning", quantity("s"))
    option(parser, "--duration", "S", "play only this long", quantity("s"))
    option(parser, "--topics", "TOPIC", "play only these (default: all)", nargs="+")
    repeated(parser, "--remap", "/OLD:=/NEW", "rename a topic")


def run_play(args: argparse.Namespace) -> int:
    """Publish the messages of a bag at their times."""
    for remap in args.remap:
        if ":=" not in remap:
            raise UsageError(f"--remap is {remap!r}; it has to look like /old:=/new")
    return _run_node(args, "replay_node", "ReplayNode")


def _run_node(args: argparse.Namespace, module: str, node: str) -> int:
    """Run a node class of ``stickslip_ros.ros.nodes`` until it ends; return its exit code.

    Options that were given are its parameters. Raises UsageError where there is no ROS.
    """
    with require_ros():
        from rclpy.parameter import Parameter

        from stickslip_ros.ros.nodes.process import run
    kind = getattr(import_module(f"stickslip_ros.ros.nodes.{module}"), node)
    given = {name: value for name, value in vars(args).items() if name not in _NO_PARAMETERS}
    overrides = [
        Parameter(name, value=value) for name, value in given.items() if value not in (None, [])
    ]
    program = f"stickslip bag {args.action}"
    rules = [word for remap in getattr(args, "remap", ()) for word in ("-r", remap)]
    return run(
        program,
        [program, "--ros-args", *rules] if rules else [program],
        lambda: kind(parameter_overrides=overrides),
    )


# -- resimulate


def resimulate_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.description = (
        "Rebuilds the run from the parameters and commands in the bag. The same version gives "
        "every recorded state again: bit for bit where the processor rounds as that of the "
        "recording, else within 1e-12 of the largest value; exit code 1 if it does not. "
        "With --set it answers 'what if': the same commands, other parameters."
    )
    _add_bag(parser)
    repeated(parser, "--set", "NAME=VALUE", "change a parameter")
    option(parser, "--out", "DIR", "write the computed run as a new bag", Path)
    add_outputs(parser, table="the differences")


def run_resimulate(args: argparse.Namespace) -> int:
    """Simulate a recorded axis again; compare, or change parameters."""
    from stickslip_ros.axis.command import JOINT_STATE
    from stickslip_ros.base.compiled import report_compilation
    from stickslip_ros.recordings import open_bag, recorded_runs, resimulate

    check_outputs(args)
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
    reports = [one.as_json() for one in runs]
    texts = [_differences(_printable(report), bool(changes)) for report in reports]
    texts += [f"written to {args.out}"] if args.out else []
    content = {"bag": str(args.bag), "changes": changes, "runs": reports}
    names = ("largest", "unit", "at", "unequal", "values")
    rows = [[printable(one["axis"]), printable(name), *(d[key] for key in names)]
            for one in reports for name, d in one["differences"].items()]  # fmt: skip
    table = ("axis", "quantity", *names), rows
    put_out(args, content, lambda: "\n\n".join(texts), f"Run of {args.bag} again", table)
    return 0 if changes or all(one.same_up_to_rounding for one in runs) else _DIFFERENT


def _differences(report: dict[str, Any], changed: bool) -> str:
    from stickslip_ros.physics.model.versions import FIRST_VERSION

    lines = [
        f"{report['axis']}: {report['commands']} commands, {report['states']} states "
        f"over {report['duration']:.3f} s"
    ]
    if report["version"] != report["this_version"]:
        lines.append(
            f"recorded by version {report['version'] or '?'}, run again by {report['this_version']}"
        )
    recorded, this = report["model_version"], report["this_model_version"]
    models = f"recorded with model {recorded}, this is model {this}"
    if recorded > this:
        lines.append(f"{models}: install a newer version")
    elif recorded < FIRST_VERSION:
        lines.append(f"{models}: what changed before version 1.0.0 is not listed")
    else:
        lines += [
            f"{models}: differs by at most {change['largest']} "
            f"(since model {change['version']}, {change['what']})"
            for change in report["model_changes"]
        ]
    lines += [f"left out: {text}" for text in report["left_out"]]
    if unknown := report["unknown_velocities"]:
        lines.append(
            f"{unknown} mean velocities of joint_states were not compared: the report before them "
            "is not in the bag"
        )
    if report["bit_for_bit"]:
        lines.append("every recorded state came out again, bit for bit")
        return "\n".join(lines)
    if report["arithmetic"] != report["this_arithmetic"] and not changed:
        recorded = report["arithmetic"] or "not noted before 2.0.0"
        lines.append(f"arithmetic of the recording: {recorded}, here: {report['this_arithmetic']}")
    if report["same_up_to_rounding"]:
        lines.append(
            "every recorded state came out again, the same up to rounding of another processor"
        )
    against = "the run as recorded" if changed else "what was recorded"
    lines.append(f"{'largest difference to ' + against:<44}{'at (s)':>12}{'unequal':>20}")
    for name, d in report["differences"].items():
        at = "" if d["at"] is None else f"{d['at']:.6f}"
        lines.append(
            f"  {name:<26}{d['largest']:>12.3e} {d['unit']:<4}{at:>12}"
            f"{d['unequal']:>10} of {d['values']}"
        )
    return "\n".join(lines)


# -- recover and export


def recover_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.description = (
        "Writes everything that is whole into a new bag; the old one stays as it is. "
        "Exit code 3 if the old bag was not complete; stderr says what was wrong with it."
    )
    _add_bag(parser)
    option(parser, "--out", "NEW", "folder to make (default: BAG_recovered)", Path)
    add_outputs(parser)


def run_recover(args: argparse.Namespace) -> int:
    """Make a good bag out of one whose recorder was killed."""
    from stickslip_ros.recordings import bytes_of, recover

    check_outputs(args)
    with progress_bar(bytes_of(args.bag), "recovering bytes") as bar:
        done = recover(args.bag, args.out, bar.update)
    found = asdict(done)
    kept = f"{done.messages} messages kept, {done.dropped_bytes} bytes dropped"
    content = {"bag": str(found.pop("folder")), **found}
    put_out(args, content, lambda: f"{done.folder}: {kept}", f"Recovered from {args.bag}")
    if not args.json:
        for finding in done.findings:
            print(f"stickslip bag recover: {finding}", file=sys.stderr)
    return _DOUBTFUL if done.findings else 0


def export_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.description = (
        "A folder takes a CSV file for each topic, a file one table of all topics, a row for each "
        "moment, in order of time. Times are in s by the clock of the stamps, since the start of "
        "the bag or, by another clock than the recorder's, the first stamp; what has none stands "
        "where the joint states show that clock to be."
    )
    _add_bag(parser)
    text = "new folder, or a file FILE.csv or FILE.parquet (default: BAG_tables)"
    option(parser, "--out", "DIR|FILE", text, Path)


def run_export(args: argparse.Namespace) -> int:
    """Write a recording as tables for other programs."""
    from stickslip_ros.recordings import open_bag
    from stickslip_ros.recordings.export import export

    bag_name = args.bag.expanduser().absolute()
    out = args.out or bag_name.with_name(f"{bag_name.stem}_tables")
    with open_bag(args.bag) as bag, progress_bar(bag.message_count, "exporting messages") as bar:
        done = export(bag, out, bar.update)
    print(out)
    for note in done.notes:
        print(f"stickslip bag export: {printable(note)}", file=sys.stderr)
    for reason in done.left_out.values():
        print(f"stickslip bag export: left out: {reason}", file=sys.stderr)
    return 1 if done.left_out else 0
