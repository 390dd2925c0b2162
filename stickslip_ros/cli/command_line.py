# SPDX-License-Identifier: Apache-2.0
"""The subcommands of ``stickslip``, each imported only when it is named.

A new subcommand is a module in this folder, with ``arguments`` and ``run``, and a row of
`SUBCOMMANDS`. Of several in one module, each has a function of its own, such as ``run_shape``.
"""

from __future__ import annotations

import argparse
import codecs
import importlib
import io
import re
import sys
from collections.abc import Callable, Collection, Mapping, Sequence
from types import ModuleType
from typing import Any, NoReturn

from stickslip_ros.base.errors import (
    INTERRUPTED,
    OUT_OF_MEMORY,
    MissingLibrary,
    StickslipError,
    libraries_for,
)
from stickslip_ros.version import __version__

_BAD_USE = 2

#: The list of the help, in this order: each subcommand and its purpose.
SUBCOMMANDS = {
    "simulate": "run steps from rest and print step size, backstep and 0-amplitude",
    "explore": "open a local page with sliders for the drive and curves that follow them",
    "sweep": "vary one or two parameters and compute step size, force, 0-amplitude, ...",
    "predict": "compute the step in closed form, or the amplitude for a wanted step",
    "analyse": "print steps, backsteps and ringing of a trace or a measurement",
    "compare": "show how a measurement differs from a run",
    "shape": "find the slip in two parts that leaves the least ringing",
    "elongate": "find the hold times around the slip that give the largest step",
    "identify": "find the parameters of the contact from measurements, with 95 % intervals",
    "identify-actuator": "find hysteresis and creep of an actuator from a recording",
    "twin": "run the model beside a recorded axis: what changed, where the next move ends",
    "bag": "work with recordings: info, record, play, resimulate, recover, export",
    "send": "send a command to a running axis over ROS 2: steps, jog, position, stop, ...",
    "watch": "show what a running axis does: state, position, refused commands",
    "emulate": "simulate axes that answer like a real controller, over TCP",
    "demo": "drive a simulated axis over ROS 2, record it and plot the run",
    "warm-up": "compile the solver ahead, for images and caches of CI",
}

#: Modules that do not have the name of the subcommand, with _ for -.
_MODULES = {
    **dict.fromkeys(("predict", "shape", "elongate"), "design"),
    "send": "running_axis",
    "watch": "running_axis",
    "demo": "installation",
    "warm-up": "installation",
}
#: Old subcommands, and their replacements.
MOVED = {
    "completion": "it left in 2.0.0: stickslip COMMAND --help lists the options of a command",
    "paper": 'make paper ARGS="..." in a checkout simulates its figures and tables (docs/paper.md)',
    "bench": 'make bench ARGS="..." in a checkout measures speed and error (docs/benchmark.md)',
    "soak": 'make soak ARGS="--hours 2" in a checkout runs axis and recorder for hours',
}


class Parser(argparse.ArgumentParser):
    """A parser whose errors are one line, and that takes -1e-3 and -5um for values."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        number = r"-(\d+\.?\d*|\.\d+)(e[-+]?\d+)?\s*[^\W\d]*(/\w+)?$|-inf$"
        self._negative_number_matcher = re.compile(number, re.I)

    def error(self, message: str) -> NoReturn:
        """Print the error and where to find the options, and exit."""
        self.exit(_BAD_USE, f"{_who(self.prog)} {message}; see {self.prog} --help\n")

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if isinstance(value, str) and action.choices is not None and value not in action.choices:
            import difflib

            near = difflib.get_close_matches(value.lower(), map(str, action.choices), 1)
            if near:
                text = f"invalid choice: {value!r}; did you mean {near[0]!r}?"
                raise argparse.ArgumentError(action, text)
        super()._check_value(action, value)


def _who(name: str) -> str:
    from stickslip_ros.base.reporting.terminal import style_text  # --version needs no library

    return style_text(f"{name}:", "bold red", sys.stderr)


def parser_for(argv: Sequence[str] | None = None) -> argparse.ArgumentParser:
    """Return the parser for a command line, with the options of the subcommand that it names.

    Without argv it has those of every subcommand, all of which it loads.
    """
    named: Collection[str] = SUBCOMMANDS
    if argv is not None:
        named = [next((text for text in argv if not text.startswith("-")), "")]
    parser = Parser(
        prog="stickslip", description="Simulator of piezo stick-slip micro-drives (CEIM)."
    )
    parser.add_argument("--version", action="version", version=__version__)
    add_commands(
        parser, "command", SUBCOMMANDS, named,
        lambda name: importlib.import_module(
            f"{__package__}.{_MODULES.get(name, name.replace('-', '_'))}"
        ),
    )  # fmt: skip
    return parser


def add_commands(
    parser: argparse.ArgumentParser,
    dest: str,
    texts: Mapping[str, str],
    named: Collection[str],
    module_of: Callable[[str], ModuleType],
) -> None:
    """Add commands with their texts; named ones get the options that their modules give them."""
    subparsers = parser.add_subparsers(required=True, metavar=dest.upper(), dest=dest)
    for name, text in texts.items():
        about = f"{text[0].upper()}{text[1:]}."
        # argparse fills in values at % in a help text, but not in a description.
        command = subparsers.add_parser(name, help=text.replace("%", "%%"), description=about)
        if name in named:
            word = name.replace("-", "_")
            with libraries_for(name):
                module = vars(module_of(name))
            command.set_defaults(run=module.get(f"run_{word}", module.get("run")))
            add_options = module.get(f"{word}_arguments") or module["arguments"]
            add_options(command)


def run(argv: Sequence[str] | None) -> int:
    """Run a command line (without the program's name); return its exit code."""
    _replace_unprintable()
    given = sys.argv[1:] if argv is None else list(argv)
    try:
        parser = parser_for(given)
    except MissingLibrary as error:
        print(_who("stickslip"), error, file=sys.stderr)
        return _BAD_USE
    if given and given[0] in MOVED:
        parser.error(f"{given[0]} has moved: {MOVED[given[0]]}")
    args, unknown = parser.parse_known_args(given)
    name = " ".join(["stickslip", args.command, *([args.action] if "action" in args else [])])
    if unknown:
        from stickslip_ros.physics.parameters import PARAMETERS

        option, _, value = unknown[0].lstrip("-").replace("-", "_").partition("=")
        value = value or (unknown[1] if len(unknown) > 1 else "VALUE")
        cure = f"; parameters are set by --set {option}={value}" if option in PARAMETERS else ""
        text = f"unrecognized arguments: {' '.join(unknown)}{cure}; see {name} --help"
        print(_who(name), text, file=sys.stderr)
        return _BAD_USE
    return finish(name, args)


def finish(name: str, args: argparse.Namespace) -> int:
    """Call ``args.run`` and return its exit code; errors are one line that begins with the name."""
    try:
        with libraries_for(name.removeprefix("stickslip ")):
            code = int(args.run(args))
        if getattr(args, "show", False) and args.plot.exists():
            import webbrowser  # --version does without it

            print(f"picture: {args.plot}", file=sys.stderr)
            webbrowser.open(args.plot.resolve().as_uri())
        return code
    except (StickslipError, MemoryError) as error:
        text = OUT_OF_MEMORY if isinstance(error, MemoryError) else str(error)
        print(_who(name), text, file=sys.stderr)
        return _BAD_USE
    except KeyboardInterrupt:
        print(f"{name}: interrupted", file=sys.stderr)
        return INTERRUPTED


#: Replacements of characters that the encoding of the output lacks.
_PLAIN = {
    "\u2212": "-", "\u2013": "-", "\u2014": "-", "\u00d7": "x", "\u00b1": "+-", "\u00b5": "u",
    "\u2264": "<=", "\u2265": ">=", "\u2026": "...", "\u2019": "'", "\u00b0": " deg",
    "\u03c3": "sigma", "\u03b1": "alpha", "\u2080": "0", "\u2081": "1", "\u2082": "2",
}  # fmt: skip


def _replace_unprintable() -> None:
    """Replace characters that the encoding of the output lacks, such as \u2212, by others."""

    def replaced(error: UnicodeError) -> tuple[str, int]:
        if not isinstance(error, UnicodeEncodeError):
            raise error
        lacking = error.object[error.start : error.end]
        return "".join(_PLAIN.get(one, "?") for one in lacking), error.end

    codecs.register_error("stickslip", replaced)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="stickslip")
