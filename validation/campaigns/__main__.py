# SPDX-License-Identifier: Apache-2.0
"""``make campaigns``: long studies, one after the other; each takes minutes to hours."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from validation.campaigns.arguments import arguments
from validation.campaigns.hostile import CASES

#: What ``make campaigns ARGS=--help`` shows
TEXT = """Runs long studies, each of minutes to hours; all of them without a name:

{}

Options after a single name are those of that study, as in "crossings --count 500 --seed 7".
mutants.py, which needs a file of coverage.py, is started by itself."""


class Campaign(NamedTuple):
    """A command line of Python, and what it shows."""

    text: str
    command: tuple[str, ...]  #: after ``python -m``
    environment: Mapping[str, str] = {}


def _tests(files: str, text: str, **environment: str) -> Campaign:
    """Return a campaign of tests that environment variables make longer."""
    paths = sorted(map(str, (Path(__file__).parent / "tests").glob(files)))
    return Campaign(text, ("pytest", "-n", "0", *paths), environment)


_STUDIES = "validation.campaigns."
CAMPAIGNS: dict[str, Campaign] = {
    "accuracy": Campaign(
        "random drives, however stiff, against the kernel at a thousandth of its tolerance",
        (f"{_STUDIES}drives", "--judge", "kernel", "--count", "500", "--radians", "1e12"),
    ),
    "crossings": Campaign(
        "journeys of users with all they cross: works, refused, unclear, wrong, crash",
        (f"{_STUDIES}crossings", "--count", "500"),
    ),
    "drives": Campaign(
        "errors of random drives with every effect, over all of the parameters' ranges",
        (f"{_STUDIES}drives", "--count", "500"),
    ),
    "topics": Campaign(
        "random drives that are commanded over topics: ~/truth at rest",
        (f"{_STUDIES}drives", "--judge", "topics", "--count", "15"),
    ),
    "controller": Campaign(
        "random sequences of commands, held against a state machine that knows no physics",
        (f"{_STUDIES}controller", "--count", "500"),
    ),
    "targets": Campaign(
        "targets of the closed loop over ranges, loads and effects: ends, times, errors",
        (f"{_STUDIES}targets", "--count", "1000"),
    ),
    "comparisons": Campaign(
        "whether compare tells a wrong preload and no right one",
        (f"{_STUDIES}comparisons", "40", "7000"),
    ),
    "traces": Campaign("what is said of traces of 32 kinds", (f"{_STUDIES}traces", "7")),
    "told": Campaign(
        "the same, told the frequency of the drive", (f"{_STUDIES}traces", "--told", "7")
    ),
    "searches": Campaign(
        "runs and steps found in traces of several runs and random disturbances",
        (f"{_STUDIES}traces", "--kinds", "at random", "200"),
    ),
    **{
        name: Campaign(text, (f"{_STUDIES}identification", name, count, first))
        for name, text, count, first in (
            ("intervals", "how often 95 % intervals hold the truth", "200", "1001"),
            ("misfit", "whether what the model does not have is told", "198", "1"),
        )
    },
    **{
        f"twin-{name}": Campaign(f"the twin: {text}", (f"{_STUDIES}twins", name, count))
        for name, text, count in (
            ("alarms", "false alarms against the rate that is set", "200"),
            ("told", "cycles until a change of the preload is told", "100"),
            ("intervals", "how often intervals and predictions hold", "100"),
            ("causes", "which causes are named", "10"),
        )
    },
    "parameters": Campaign(
        "sets of parameters over all ranges", (f"{_STUDIES}parameter_sets", "--count", "20000")
    ),
    **{name: Campaign(case.text, (f"{_STUDIES}hostile", name)) for name, case in CASES.items()},
    "processors": Campaign(
        "the same bits with other features of the processor, and a digest that says where not",
        ("pytest", "-n", "0", "test/golden", "-k", "another"),
    ),
    "warm-up": _tests("test_warm_up.py", "nothing is left to compile", STICKSLIP_WARM_UP="1"),
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the campaigns that are named, all without a name; return 1 if one fails."""
    given = list(sys.argv[1:] if argv is None else argv)
    options = given[1:] if len(given) > 1 and given[1].startswith("-") else []
    width = max(map(len, CAMPAIGNS))
    listed = "\n".join(f"  {name:<{width}}  {one.text}" for name, one in CAMPAIGNS.items())
    asked = given[: len(given) - len(options)]
    names = arguments(TEXT.format(listed), asked, {"names": []}).names or list(CAMPAIGNS)
    if unknown := [name for name in names if name not in CAMPAIGNS]:
        known = ", ".join(CAMPAIGNS)
        print(f"there is no campaign {unknown[0]!r}; known: {known}", file=sys.stderr)
        return 2
    failed = []
    for name in names:
        campaign = CAMPAIGNS[name]
        print(f"== {name}: {campaign.text}", flush=True)
        environment = {**os.environ, **campaign.environment}
        command = [sys.executable, "-m", *campaign.command, *options]
        if subprocess.run(command, env=environment, check=False).returncode:
            failed.append(name)
    print(f"failed: {', '.join(failed)}" if failed else "all passed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
