# SPDX-License-Identifier: Apache-2.0
"""Libraries of others: what they raise, print and log of broken files becomes our own words."""

from __future__ import annotations

import contextlib
import io
import logging
import warnings
from collections.abc import Iterator

from stickslip_ros.measurement.reading.table import MeasurementError
from stickslip_ros.opening import ReadError


class _Listener(logging.Handler):
    """Keeps the first of what a library logs, instead of stderr."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.said: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        if not self.said:
            self.said.append(" ".join(record.getMessage().split())[:160])


@contextlib.contextmanager
def listening(library: str) -> Iterator[list[str]]:
    """Give the first of what a library warns of, as soon as there is something."""
    listener = _Listener()
    names = [name for name in logging.root.manager.loggerDict if name.split(".")[0] == library]
    loggers = [logging.getLogger(name) for name in {library, *names}]
    before = [(logger, logger.handlers, logger.propagate) for logger in loggers]
    for logger in loggers:
        logger.handlers, logger.propagate = [listener], False
    try:
        yield listener.said
    finally:
        for logger, handlers, propagate in before:
            logger.handlers, logger.propagate = handlers, propagate


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
            text = " ".join(str(error).split())[:160]
            raise MeasurementError(
                f"its {kind} cannot be read: {text or type(error).__name__}; export it as text"
            ) from None


def missing(what: str, library: str) -> MeasurementError:
    """Return the error that says which library is not installed."""
    return MeasurementError(
        f"{what} are read by {library}, which is not installed; install it with "
        f"pip install {library}, or export the measurement as text"
    )
