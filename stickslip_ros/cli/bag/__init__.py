# SPDX-License-Identifier: Apache-2.0
"""``stickslip bag``: what can be done with recordings, one file each."""

from __future__ import annotations

import argparse

from stickslip_ros.cli.bag import export, info, play, record, recover, resimulate

#: In the order of the help. Each has an ``add_parser``, as the subcommands of ``stickslip`` have.
ACTIONS = (info, record, play, resimulate, recover, export)


def add_parser(subparsers: argparse._SubParsersAction) -> None:  # type: ignore[type-arg]
    """Add the subcommand with its actions."""
    parser = subparsers.add_parser("bag")
    actions = parser.add_subparsers(required=True, metavar="ACTION", dest="action")
    for action in ACTIONS:
        action.add_parser(actions)
