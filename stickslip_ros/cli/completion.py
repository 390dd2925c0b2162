# SPDX-License-Identifier: Apache-2.0
"""``stickslip completion``: a script that lets a shell complete subcommands, options and files."""

from __future__ import annotations

import argparse
from pathlib import Path

from stickslip_ros.cli.options import UsageError

SHELLS = ("bash", "zsh", "fish")
_PLACES = {
    "bash": "~/.local/share/bash-completion/completions/stickslip",
    "zsh": "a folder of $fpath, as _stickslip",
    "fish": "~/.config/fish/completions/stickslip.fish",
}


def add_parser(subparsers: argparse._SubParsersAction) -> None:  # type: ignore[type-arg]
    """Add the subcommand."""
    places = "; ".join(f"{shell}: {place}" for shell, place in _PLACES.items())
    parser = subparsers.add_parser("completion", epilog=f"Write the script to a file. {places}.")
    parser.add_argument("shell", choices=SHELLS)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run the subcommand; return the exit code."""
    try:
        import shtab
    except ImportError:
        raise UsageError("needs shtab: pip install shtab") from None
    parser = args.full_parser()
    _complete_files(parser, shtab.FILE)
    print(shtab.complete(parser, args.shell))
    return 0


def _complete_files(parser: argparse.ArgumentParser, how: object) -> None:
    for action in parser._actions:
        if action.type is Path:
            action.complete = how  # type: ignore[attr-defined]
        if isinstance(action, argparse._SubParsersAction):
            for inner in dict.fromkeys(action.choices.values()):
                _complete_files(inner, how)
