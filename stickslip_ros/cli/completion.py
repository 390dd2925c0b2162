# SPDX-License-Identifier: Apache-2.0
"""``stickslip completion``: a script that lets a shell complete commands, options, names, files."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

import shtab

from stickslip_ros.shared_files import shared

SHELLS = ("bash", "zsh", "fish")
_PLACES = {
    "bash": "~/.local/share/bash-completion/completions/stickslip",
    "zsh": "a folder of $fpath, as _stickslip",
    "fish": "~/.config/fish/completions/stickslip.fish",
}


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the subcommand."""
    places = "; ".join(f"{shell}: {place}" for shell, place in _PLACES.items())
    parser.epilog = f"Write the script to a file. {places}."
    parser.add_argument("shell", choices=SHELLS)


def run(args: argparse.Namespace) -> int:
    """Run the subcommand; return the exit code."""
    from stickslip_ros.cli.command_line import full_parser

    parser = full_parser()
    _complete(parser, _names())
    print(shtab.complete(parser, args.shell))
    return 0


def _names() -> Mapping[str, Sequence[str]]:
    """Return the choices for the values of options, by destination."""
    from stickslip_ros.axis.commands import COMMANDS
    from stickslip_ros.cli.sweep import METRIC_NAMES
    from stickslip_ros.parameters import PARAMETERS

    config = shared("config/table1_typical.yaml").parent
    return {
        "assignments": [f"{name}=" for name in PARAMETERS],
        "vary": [f"{name}=" for name, row in PARAMETERS.items() if row.kind is float],
        "fit": list(PARAMETERS),
        "metric": list(METRIC_NAMES),
        "name": list(COMMANDS),
        "config": sorted(file.name for file in config.glob("*.yaml")),
    }


def _complete(parser: argparse.ArgumentParser, names: Mapping[str, Sequence[str]]) -> None:
    """Set the completion of every option of a parser and of its subcommands."""
    for action in parser._actions:
        known = names.get(action.dest)
        if known and action.choices is None:
            action.choices = [*known, *([shtab.Choice("file")] if action.type is Path else [])]
        elif action.type is Path:
            action.complete = shtab.FILE  # type: ignore[attr-defined]
        if isinstance(action, argparse._SubParsersAction):
            for inner in dict.fromkeys(action.choices.values()):
                _complete(inner, names)
