# SPDX-License-Identifier: Apache-2.0
"""``stickslip bag export``: a recording as tables for other programs."""

from __future__ import annotations

import argparse
from pathlib import Path

from stickslip_ros.cli.options import option, progress_bar


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the action."""
    parser.description = (
        "A folder takes a CSV file for each topic, a file one table of all topics, a row for each "
        "moment. Times are in s since the start of the bag, from the stamps in the messages where "
        "they have one."
    )
    option(parser, "bag", "BAG", "folder of a bag, or one file of it", Path)
    text = "new folder, or a file FILE.csv or FILE.parquet (default: BAG_tables)"
    option(parser, "--out", "DIR|FILE", text, Path)


def run(args: argparse.Namespace) -> int:
    """Run the action; return the exit code."""
    from stickslip_ros.recordings import open_bag
    from stickslip_ros.recordings.export import export

    bag_name = args.bag.expanduser().absolute()
    out = args.out or bag_name.with_name(f"{bag_name.stem}_tables")
    with open_bag(args.bag) as bag, progress_bar(bag.message_count, "exporting messages") as bar:
        print(export(bag, out, bar.update))
    return 0
