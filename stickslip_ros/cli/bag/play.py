# SPDX-License-Identifier: Apache-2.0
"""``stickslip bag play``: publish what a bag holds, at its times."""

from __future__ import annotations

import argparse

from stickslip_ros.cli.options import run_node


def add_parser(subparsers: argparse._SubParsersAction) -> None:  # type: ignore[type-arg]
    """Add the subcommand."""
    parser = subparsers.add_parser(
        "play",
        help="publish the messages of a bag at their times, with their recorded QoS",
        epilog="Also as a node, ros2 run stickslip_ros replay_node, with the same options as "
        "parameters.",
    )
    parser.add_argument("bag", metavar="BAG", help="folder of a bag, or one of its files")
    parser.add_argument("--rate", type=float, metavar="X", help="speed (default: 1)")
    parser.add_argument("--loop", action="store_true", default=None, help="repeat without end")
    parser.add_argument(
        "--clock",
        type=float,
        nargs="?",
        const=100.0,
        metavar="HZ",
        help="publish /clock (default rate: 100 Hz)",
    )
    parser.add_argument("--start", type=float, metavar="S", help="skip this time at the beginning")
    parser.add_argument("--duration", type=float, metavar="S", help="play only this long")
    parser.add_argument(
        "--topics", nargs="+", metavar="TOPIC", help="play only these (default: all)"
    )
    parser.add_argument(
        "--remap", action="append", default=[], metavar="/OLD:=/NEW", help="rename a topic"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run the subcommand; return the exit code."""
    return run_node(
        "stickslip bag play",
        "replay_node",
        "ReplayNode",
        {
            "bag": args.bag,
            "rate": args.rate,
            "loop": args.loop,
            "clock": args.clock,
            "start": args.start,
            "duration": args.duration,
            "topics": args.topics,
        },
        args.remap,
    )
