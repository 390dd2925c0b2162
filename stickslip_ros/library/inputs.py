# SPDX-License-Identifier: Apache-2.0
"""What every function of the library takes: parameters in any form, and results as tables."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stickslip_ros.errors import StickslipError
from stickslip_ros.parameters import Parameters, read_yaml
from stickslip_ros.shared_files import config_file

if TYPE_CHECKING:
    import pandas

#: Parameters, a mapping of some by name, or a YAML file: a path, or the name of one in ``config/``.
ParameterSource = Parameters | Mapping[str, Any] | str | PathLike[str] | None


class MissingLibrary(StickslipError, ImportError):
    """An optional library is not installed; the message says how to install it."""


def full_set(source: ParameterSource, values: Mapping[str, Any]) -> Parameters:
    """Return the parameters of a source (None: the defaults), with values laid over them.

    Raises ParameterError.
    """
    if source is None:
        source = Parameters()
    elif not isinstance(source, Parameters | Mapping):
        source = read_yaml(config_file(Path(source)))
    return Parameters.of(source).replace(**values)


def frame(columns: Mapping[str, Any], index: str) -> pandas.DataFrame:
    """Return columns of one length as a pandas DataFrame whose index counts from 1."""
    try:
        import pandas
    except ImportError:
        raise MissingLibrary("to_frame needs pandas: pip install pandas") from None
    table = pandas.DataFrame(dict(columns))
    table.index = pandas.RangeIndex(1, len(table) + 1, name=index)
    return table
