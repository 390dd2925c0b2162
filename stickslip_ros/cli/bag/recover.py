# SPDX-License-Identifier: Apache-2.0
"""``stickslip bag recover``: a good bag out of one whose recorder was killed."""

from __future__ import annotations

import argparse
import sys
from dataclasses import asdict
from pathlib import Path

from stickslip_ros.cli.options import add_outputs, option, print_result, progress_bar

#: The old bag was not whole: something is missing or cannot be vouched for.
_DOUBTFUL = 3


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the action."""
    parser.description = (
        "Writes everything that is whole into a new bag; the old one stays as it is. "
        "Exit code 3 if the old bag was not complete; stderr says what was wrong with it."
    )
    option(parser, "bag", "BAG", "folder of the bag, or one .mcap file", Path)
    option(parser, "--out", "NEW", "folder to make (default: BAG_recovered)", Path)
    add_outputs(parser)


def run(args: argparse.Namespace) -> int:
    """Run the action; return the exit code."""
    from stickslip_ros.recordings import bytes_of, recover

    with progress_bar(bytes_of(args.bag), "recovering bytes") as bar:
        done = recover(args.bag, args.out, bar.update)
    found = asdict(done)
    kept = f"{done.messages} messages kept, {done.dropped_bytes} bytes dropped"
    content = {"bag": str(found.pop("folder")), **found}
    print_result(args, content, lambda: f"{done.folder}: {kept}")
    if not args.json:
        for finding in done.findings:
            print(f"stickslip bag recover: {finding}", file=sys.stderr)
    return _DOUBTFUL if done.findings else 0
