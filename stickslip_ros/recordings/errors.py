# SPDX-License-Identifier: Apache-2.0
"""The error of all that reads and writes bags."""

from __future__ import annotations

import contextlib
import struct
from collections.abc import Iterator
from pathlib import Path

from mcap.exceptions import McapError

from stickslip_ros.base.errors import StickslipError
from stickslip_ros.base.opening import ReadError

BROKEN = (struct.error, McapError, ValueError, OverflowError)
"""What reading broken bytes ends in, here and in the library."""


class BagError(StickslipError):
    """A bag cannot be made, written or read; the text is one line with the path and the cure."""


def damaged(path: Path, what: str) -> BagError:
    """Return the error for a file that violates its format.

    what: the violation, without a full stop.
    """
    return BagError(
        f"{path} is damaged: {what}; `stickslip bag recover` makes a new bag of what is whole in it"
    )


def short(error: BaseException) -> str:
    """Return the text of an error of others in one line of at most 200 characters."""
    return " ".join(str(error).split())[:200] or type(error).__name__


@contextlib.contextmanager
def reading(path: Path) -> Iterator[None]:
    """Turn whatever broken bytes lead to into a BagError that names the file."""
    try:
        yield
    except BagError:
        raise
    except ReadError as error:
        raise BagError(str(error)) from error
    except OSError as error:
        raise BagError(
            f"cannot read {path}: {error.strerror or error}; check the name and your rights to it"
        ) from error
    except BROKEN as error:
        raise damaged(path, short(error) if str(error) else "it ends inside a record") from error
