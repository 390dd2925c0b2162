# SPDX-License-Identifier: Apache-2.0
"""``stickslip bag play``: publish the messages of a bag at their times."""

from __future__ import annotations

import argparse

from stickslip_ros.cli.options import flag, option, quantity, repeated, run_node


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the action."""
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


def run(args: argparse.Namespace) -> int:
    """Run the subcommand; return the exit code."""
    return run_node(
        "stickslip bag play",
        "replay_node",
        "ReplayNode",
        {
            name: getattr(args, name)
            for name in ("bag", "rate", "loop", "clock", "start", "duration", "topics")
        },
        args.remap,
    )
