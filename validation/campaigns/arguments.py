# SPDX-License-Identifier: Apache-2.0
"""The command line of a campaign: each names what it takes, and this reads it."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from typing import Any


def arguments(
    text: str | None,
    argv: Sequence[str] | None = None,
    places: Mapping[str, Any] | None = None,
    **options: Any,
) -> argparse.Namespace:
    """Return what the command line of a campaign says.

    text: what ``--help`` shows first, the docstring of the campaign.
    places: names without dashes; each with a type if it is needed, with a default if it can be left
    out, with a set if it is one of these, with a list if there may be any number of it.
    options: names with their defaults; False stands for a switch, a tuple for one word or more, a
    list for one of its words, the first if none is given.
    """
    parser = argparse.ArgumentParser(
        description=text, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    for name, what in (places or {}).items():
        if isinstance(what, type):
            parser.add_argument(name, type=what)
        elif isinstance(what, list):
            parser.add_argument(name, nargs="*", default=what)
        elif isinstance(what, set):
            parser.add_argument(name, choices=sorted(what))
        else:
            parser.add_argument(name, type=type(what), nargs="?", default=what)
    for name, default in options.items():
        flag, shown = f"--{name.replace('_', '-')}", "(default: %(default)s)"
        if default is False:
            parser.add_argument(flag, action="store_true")
        elif isinstance(default, list):
            parser.add_argument(flag, choices=default, default=default[0], help=shown)
        elif isinstance(default, tuple):
            parser.add_argument(flag, nargs="+", default=default, help=shown)
        else:
            parser.add_argument(flag, type=type(default), default=default, help=shown)
    return parser.parse_args(argv)
