# SPDX-License-Identifier: Apache-2.0
"""Message types by name: the class, and the text of the definition as it is installed."""

from __future__ import annotations

import importlib
import os
import sys
from functools import cache
from pathlib import Path
from typing import Any

from stickslip_ros.errors import StickslipError
from stickslip_ros.recordings import definition_from_fields


class UnknownTypeError(StickslipError, LookupError):
    """The package of a message type is not installed, or has no such message."""


@cache
def message_class(type_name: str) -> type[Any]:
    """Return the Python class of a message type such as ``std_msgs/msg/Int32``.

    :raises UnknownTypeError: it is not installed.
    """
    try:
        package, kind, name = type_name.split("/")
        found: type[Any] = getattr(importlib.import_module(f"{package}.{kind}"), name)
    except (ValueError, ImportError, AttributeError) as error:
        package = type_name.split("/")[0]
        raise UnknownTypeError(
            f"message type {type_name} is not installed; install the package {package}"
        ) from error
    return found


@cache
def message_definition(type_name: str) -> str:
    """Return the ``.msg`` text of a message type: the installed file, else made from its fields.

    :raises UnknownTypeError: it is not installed.
    """
    for prefix in _install_prefixes():
        path = prefix / "share" / f"{type_name}.msg"
        if path.is_file():
            return path.read_text(encoding="utf-8")
    return definition_from_fields(message_class(type_name).get_fields_and_field_types())


def _install_prefixes() -> list[Path]:
    # A sourced ROS names its prefixes; packages installed by pip lie below the interpreter's own.
    sourced = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    return [Path(prefix) for prefix in (*sourced, sys.prefix) if prefix]
