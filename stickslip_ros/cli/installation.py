# SPDX-License-Identifier: Apache-2.0
"""What follows an installation: ``stickslip demo``, ``warm-up`` and ``completion``."""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path

from stickslip_ros.cli.options import option
from stickslip_ros.errors import UsageError
from stickslip_ros.shared_files import example, shared

#: The shells that completion knows, and where each looks for the script.
SHELLS = {
    "bash": "~/.local/share/bash-completion/completions/stickslip",
    "zsh": "a folder of $fpath, as _stickslip",
    "fish": "~/.config/fish/completions/stickslip.fish",
}


def demo_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    option(parser, "--out", "DIR", "(default: demo)", Path, default=Path("demo"))
    text = "(default: config/table1_typical.yaml)"
    option(parser, "--config", "FILE.yaml", text, Path)


def run_demo(args: argparse.Namespace) -> int:
    """Run the example of that name."""
    if find_spec("rclpy") is None:
        raise UsageError("needs ROS 2: source it or use `make demo`")
    example("demo").run(args.out, args.config or shared("config/table1_typical.yaml"))
    return 0


def warm_up_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the cache in the help; there are no options."""
    parser.epilog = (
        "NUMBA_CACHE_DIR chooses where the compiled code is kept. What is kept holds for "
        "this version of the package and for processors like this one."
    )


def run_warm_up(args: argparse.Namespace) -> int:
    """Compile everything ahead, for images and caches of CI."""
    from stickslip_ros.library.compile_ahead import warm_up

    begin = time.monotonic()
    warm_up()
    print(f"ready after {time.monotonic() - begin:.1f} s")
    return 0


def completion_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the shell."""
    places = "; ".join(f"{shell}: {place}" for shell, place in SHELLS.items())
    parser.epilog = f"Write the script to a file. {places}."
    parser.add_argument("shell", choices=list(SHELLS))


def run_completion(args: argparse.Namespace) -> int:
    """Print a script that lets a shell complete commands, options, names and files."""
    import shtab

    from stickslip_ros.axis.commands import COMMANDS
    from stickslip_ros.cli.command_line import parser_for
    from stickslip_ros.library.sweep_metrics import METRICS
    from stickslip_ros.parameters import PARAMETERS

    config = shared("config/table1_typical.yaml").parent
    names: Mapping[str, Sequence[str]] = {  # the choices for values, by destination
        "assignments": [f"{name}=" for name in PARAMETERS],
        "vary": [f"{name}=" for name, row in PARAMETERS.items() if row.kind is float],
        "fit": list(PARAMETERS),
        "metric": list(METRICS),
        "name": list(COMMANDS),
        "config": sorted(file.name for file in config.glob("*.yaml")),
    }

    def complete(parser: argparse.ArgumentParser) -> None:
        for action in parser._actions:
            known = names.get(action.dest)
            if known and action.choices is None:
                files = [shtab.Choice("file")] if action.type is Path else []
                action.choices = [*known, *files]
            elif action.type is Path:
                action.complete = shtab.FILE  # type: ignore[attr-defined]
            if isinstance(action, argparse._SubParsersAction):
                for inner in dict.fromkeys(action.choices.values()):
                    complete(inner)

    parser = parser_for()
    complete(parser)
    print(shtab.complete(parser, args.shell))
    return 0
