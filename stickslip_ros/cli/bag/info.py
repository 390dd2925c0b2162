# SPDX-License-Identifier: Apache-2.0
"""``stickslip bag info``: the content of a recording."""

from __future__ import annotations

import argparse
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from stickslip_ros.cli.options import add_outputs, check_outputs, option, print_result


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the action."""
    option(parser, "bag", "BAG", "folder of the bag, or one .mcap file", Path)
    add_outputs(parser, "the position over time")


def run(args: argparse.Namespace) -> int:
    """Run the action; return the exit code."""
    from stickslip_ros.recordings import describe, open_bag

    check_outputs(args)
    if args.plot:
        from stickslip_ros.measurement.load_motion import load_motion
        from stickslip_ros.reporting.picture import draw_picture

        draw_picture(args.plot, load_motion(args.bag).motion.plot)
    with open_bag(args.bag) as bag:
        found = describe(bag)
    print_result(args, found, lambda: "\n".join(_lines(found)))
    return 0


def _lines(found: dict[str, Any]) -> list[str]:
    chunks = ", ".join(name or "none" for name in found["compression"]) or "none"
    packed = f", each {found['packed']} packed as a whole" if found["packed"] else ""
    lines = [
        f"bag          {found['bag']}",
        f"size         {_bytes(found['size'])} in {len(found['files'])} files",
        f"compression  {chunks}{packed}",
        f"start        {_date(found['start_ns'])}",
        f"end          {_date(found['end_ns'])}",
        f"duration     {found['duration']:.3f} s",
        f"messages     {found['messages']}",
        f"recorded by  {', '.join(found['written_by'])}"
        f"{', ROS ' + found['ros_distro'] if found['ros_distro'] else ''}",
    ]
    lines += [f"{key:<12} {text}" for key, text in found["custom_data"].items()]
    lines += ["", "topics"]
    width = max((len(topic["name"]) for topic in found["topics"]), default=0)
    for topic in found["topics"]:
        lines.append(
            f"  {topic['name']:<{width}} {topic['messages']:>9}  {topic['type']}  {_qos(topic)}"
        )
    for name, parameters in found["axes"].items():
        lines += ["", f"axis of {name}"]
        lines += [f"  {key:<24} {text}" for key, text in parameters.items()]
    return lines


def _qos(topic: dict[str, Any]) -> str:
    """Return reliability, durability and depth as text, once for each kind of publisher."""
    kinds = {f"{one['reliability']}, {one['durability']}" for one in topic["offered_qos"]}
    return "; ".join(sorted(kinds))


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
