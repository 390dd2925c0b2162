# SPDX-License-Identifier: Apache-2.0
"""Libraries of others: loaded when a file needs them; what they say of it becomes our own words."""

from __future__ import annotations

import contextlib
import importlib
import io
import warnings
from collections.abc import Iterator
from typing import Any

from stickslip_ros.measurement.reading.table import MeasurementError
from stickslip_ros.opening import ReadError

#: Characters of a library's message that are shown.
_LONGEST = 160


def library(module: str, what: str, package: str = "") -> Any:
    """Return a module that reads what; package is the name that pip knows, if it is another.

    The packages come with ``pip install stickslip_ros[formats]``. Raises MeasurementError.
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        package = package or module
        raise MeasurementError(
            f"{what} are read by {package}, which is not installed; install it with "
            f"pip install {package}, or export the measurement as text"
        ) from None


@contextlib.contextmanager
def asking(kind: str) -> Iterator[None]:
    """Turn whatever a library says of a broken file into a MeasurementError, and keep it quiet."""
    said = io.StringIO()
    with (
        warnings.catch_warnings(),
        contextlib.redirect_stdout(said),
        contextlib.redirect_stderr(said),
    ):
        warnings.simplefilter("ignore")
        try:
            yield
        except (MeasurementError, ReadError, KeyboardInterrupt):
            raise
        except Exception as error:  # the libraries raise of every kind
            text = " ".join(str(error).split())[:_LONGEST]
            raise MeasurementError(
                f"its {kind} cannot be read: {text or type(error).__name__}; export it as text"
            ) from None
