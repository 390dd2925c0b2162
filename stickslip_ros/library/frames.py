# SPDX-License-Identifier: Apache-2.0
"""Tables of results, for notebooks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from stickslip_ros.errors import StickslipError

if TYPE_CHECKING:
    import pandas


class MissingLibrary(StickslipError, ImportError):
    """An optional library is not installed; the message says how to install it."""


def frame(columns: Mapping[str, Any], index: str) -> pandas.DataFrame:
    """Return columns of one length as a pandas DataFrame whose index counts from 1."""
    try:
        import pandas
    except ImportError:
        raise MissingLibrary("to_frame needs pandas: pip install pandas") from None
    table = pandas.DataFrame(dict(columns))
    table.index = pandas.RangeIndex(1, len(table) + 1, name=index)
    return table
