# SPDX-License-Identifier: Apache-2.0
"""Output for terminals, not for pipes: colours, notes on slow work.

Lines of a name and a value have a fixed width, so that programs that read them from a pipe find the
values in the same column; a library for tables would move them with every longer name.
"""

from __future__ import annotations

import contextlib
import math
import os
import sys
import threading
from collections.abc import Iterable, Iterator
from typing import TextIO

#: Message while runs of steps are searched for.
SEARCH = "searching the measurement for runs of steps"
_PATIENCE = 1.0  # s, after which a message tells what is being done


def style_text(text: str, style: str, stream: TextIO | None = None) -> str:
    """Style a text, for example "bold red" (styles of rich), if the stream (stdout) shows it.

    Pipes, NO_COLOR and TERM=dumb get plain text; FORCE_COLOR styles text in a pipe, too.
    """
    stream = stream or sys.stdout
    if not (stream.isatty() or os.environ.get("FORCE_COLOR")):
        return text  # and nothing is loaded for it
    from rich.console import Console
    from rich.style import Style

    console = Console(file=stream)
    if console.no_color or console.color_system is None or console.legacy_windows:
        return text
    return Style.parse(style).render(text)


def nanometres(length: float, error: float = 0.0) -> str:
    """Return a length (m) in nm; a standard error of a picometre or more sets its decimals."""
    if math.isnan(length):
        return "not measurable"
    if not error >= 1e-12:
        return f"{1e9 * length:.3f} nm"
    places = max(0, 1 - math.floor(math.log10(1e9 * error)))
    return f"{1e9 * length:.{places}f} nm, standard error {1e9 * error:.{places}f} nm"


def format_rows(rows: Iterable[tuple[str, str]], width: int = 12) -> str:
    """Format one line for each name and value, with the values in one column."""
    return "\n".join(f"{name:<{width}} {value}" for name, value in rows)


@contextlib.contextmanager
def announce_if_slow(what: str, in_pipes: bool = False) -> Iterator[None]:
    """Print what is being done on stderr if this block is slow, on a terminal or in a notebook.

    in_pipes: anywhere else, too.
    """
    if not (in_pipes or sys.stderr.isatty() or "ipykernel" in sys.modules):
        yield
        return
    stream = sys.stderr
    timer = threading.Timer(_PATIENCE, lambda: print(f"{what} ...", file=stream, flush=True))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
