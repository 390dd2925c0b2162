# SPDX-License-Identifier: Apache-2.0
"""What people see and a pipe should not get: colours, the micro sign, what takes its time.

Lines of a name and a value keep a fixed width, so that what reads them from a pipe finds the values
where they were; a library for tables would move them with every longer name.
"""

from __future__ import annotations

import contextlib
import os
import sys
import threading
from collections.abc import Iterable, Iterator
from typing import TextIO

#: What a search for steps is called.
SEARCH = "searching the measurement for runs of steps"
_PATIENCE = 1.0  # s, after which people want to know what goes on


def style_text(text: str, style: str, stream: TextIO | None = None) -> str:
    """Return a text in a style of rich, such as "bold red", if the stream (stdout) shows it.

    Not in a pipe, with NO_COLOR or with TERM=dumb; FORCE_COLOR colours in a pipe, too.
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


def micro_prefix(stream: TextIO | None = None) -> str:
    """Return the prefix of a millionth: the micro sign on a terminal that has it, else "u"."""
    stream = stream or sys.stdout
    if not stream.isatty():
        return "u"
    try:
        "µ".encode(stream.encoding or "ascii")
    except UnicodeEncodeError:
        return "u"
    return "µ"


def format_rows(rows: Iterable[tuple[str, str]], width: int = 12) -> str:
    """Return lines of a name and a value, the values below each other."""
    return "\n".join(f"{name:<{width}} {value}" for name, value in rows)


@contextlib.contextmanager
def announce_if_slow(what: str) -> Iterator[None]:
    """Say on stderr what goes on in this block if it lasts, on a terminal and in a notebook."""
    if not (sys.stderr.isatty() or "ipykernel" in sys.modules):
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
