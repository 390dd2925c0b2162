# SPDX-License-Identifier: Apache-2.0
"""The error of all that reads and writes bags."""

from __future__ import annotations

from pathlib import Path

from stickslip_ros.errors import StickslipError


class BagError(StickslipError):
    """A bag cannot be made, written or read; the text is one line with the path and the cure."""


def damaged(path: Path, what: str) -> BagError:
    """Return the error for a file that violates its format.

    :param what: the violation, without a full stop.
    """
    return BagError(
        f"{path} is damaged: {what}; `stickslip bag recover` makes a new bag of what is whole in it"
    )


def unreadable(path: Path, error: OSError) -> BagError:
    """Return the error for a file that the operating system does not let us read."""
    return BagError(
        f"cannot read {path}: {error.strerror or error}; check the name and your rights to it"
    )
