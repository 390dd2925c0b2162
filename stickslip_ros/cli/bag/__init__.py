# SPDX-License-Identifier: Apache-2.0
"""``stickslip bag``: actions on recordings, one file each."""

from __future__ import annotations

import argparse

from stickslip_ros.cli.command_line import add_commands

#: In the order of the help; each has ``arguments`` and ``run``, as the subcommands have.
ACTIONS = {
    "info": "topics, times, sizes, QoS and the parameters of the recorded axis",
    "record": "record topics until Ctrl-C (default: all topics of the axis)",
    "play": "publish the messages of a bag at their times, with their recorded QoS",
    "resimulate": "compute a recorded run again and compare every state with the recorded one",
    "recover": "make a good bag from an unfinished or damaged one",
    "export": "write the messages as tables, CSV or Parquet",
}


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the actions."""
    add_commands(parser, "action", "stickslip_ros.cli.bag", ACTIONS, list(ACTIONS))
