# SPDX-License-Identifier: Apache-2.0
"""Hostile treatment of nodes, controllers, commands and files, each case by its name.

    python -m validation.campaigns.hostile [NAME ...] [--count N] [--seed 1] [--only WORD]

Nobody may die, raise, hang, grow or keep others waiting, and what is left has to be whole. Times
for which a process waited for nothing but a processor are taken off, so a busy machine counts as an
idle one. --count is in the unit that the table names; --only is a command for interrupts, and who
ends how for endings ("recorder, KILL").
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from typing import NamedTuple

from validation.campaigns.arguments import arguments


class Case(NamedTuple):
    """What is treated, and by whom."""

    text: str
    unit: str
    usual: float  #: so many of the unit
    short: float  #: for a test
    where: str  #: module and function, which takes count and seed and returns the bad ones
    only: str = ""

    def run(self, count: float, seed: int, only: str = "") -> int:
        """Treat it, print what was seen, return how much of that was bad."""
        module, _, name = self.where.partition(":")
        judge: Callable[..., int] = getattr(import_module(f"validation.campaigns.{module}"), name)
        only = only or self.only
        return judge(type(self.usual)(count), seed, *([only] if only else []))


CASES = {
    "floods": Case(
        "hostile bytes on all that two axes and a recorder hear, 5000 messages a second",
        *("minutes", 10.0, 0.2, "hostile_nodes:flooded"),
    ),
    "clock": Case(
        "the same, while the clock of the nodes is set by a day, on and back",
        *("minutes", 10.0, 0.2, "hostile_nodes:flooded", "clock"),
    ),
    "nodes": Case(
        "hostile messages and calls, one by one, to an axis and a recorder",
        *("seconds", 3600.0, 8.0, "hostile_nodes:one_by_one"),
    ),
    "client": Case(
        "hostile messages on all that a client hears",
        *("seconds", 3600.0, 4.0, "hostile_nodes:client"),
    ),
    "controllers": Case(
        "commands at random to each emulated controller",
        *("commands", 20_000, 600, "hostile_controllers:controllers"),
    ),
    "files": Case(
        "hostile contents of each file that is read", "seconds", 3600.0, 8.0, "hostile_files:files"
    ),
    "bags": Case("damaged bags", "bags", 5000, 60, "hostile_bags:bags"),
    "records": Case(
        "records of any shape: a result or a sentence",
        *("records", 2000, 20, "hostile_records:records"),
    ),
    "interrupts": Case(
        "Ctrl-C at random moments of each command", "moments", 30, 2, "interrupts:interrupts"
    ),
    "commands": Case(
        "random commands and parameters on axes of any kind, without ROS",
        *("axes", 300, 2, "commands:commands"),
    ),
    "overload": Case(
        "changes at any cost: stops and signals are heard", "sets", 200, 2, "overload:overload"
    ),
    "endings": Case(
        "recorders and axes that end at random", "moments", 300, 12, "endings:endings"
    ),
    "kills": Case(
        "recorders that are killed, each recovered to what it had flushed last",
        *("moments", 100, 1, "endings:endings", "recorder, KILL"),
    ),
    "twin": Case(
        "a twin beside an axis that is flooded, starved and started anew",
        *("minutes", 60.0, 0.5, "rough_twin:rough"),
    ),
}  # fmt: skip


def main(argv: Sequence[str] | None = None) -> int:
    """Run the cases that are named, all without a name; return 1 if anything was bad."""
    args = arguments(__doc__, argv, {"names": [*CASES]}, count=0.0, seed=1, only="")
    bad = 0
    for name in args.names:
        case = CASES[name]
        count = args.count or case.usual
        found = case.run(count, args.seed, args.only)
        print(f"{name}, {count:g} {case.unit} of seed {args.seed}: {found} bad", flush=True)
        bad += found
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
