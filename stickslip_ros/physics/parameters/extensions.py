# SPDX-License-Identifier: Apache-2.0
"""What comes from outside: rooms that add rows to the table, and packages that bring laws.

`parameters` imports none of them by name: it uses this list when the table is first read.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from importlib.metadata import entry_points
from typing import Any

from stickslip_ros.base.errors import StickslipError

#: Modules that call `parameters.register`; they load neither numba nor numpy.
ROW_PROVIDERS = ("stickslip_ros.physics.laws", "stickslip_ros.physics.waveforms")
#: Entry point groups of packages, and what registers one: its module and its name there
ENTRY_POINTS = {
    "stickslip_ros.laws": ("stickslip_ros.physics.laws", "register_law"),
    "stickslip_ros.waveforms": ("stickslip_ros.physics.waveforms", "register_waveform"),
}


class RegistrationError(StickslipError, ValueError):
    """A law or a waveform cannot be registered; the message says why, and the cure."""


def check_name(name: str, what: str, built_in: object, known: Any) -> None:
    """Raise RegistrationError where a law or waveform cannot have a name."""
    if not (isinstance(name, str) and name.isidentifier() and name.islower()):
        raise RegistrationError(
            f"the {what} is called {name!r}; a name is a small word with letters, digits and _"
        )
    if name in known and built_in:
        raise RegistrationError(f"there is a {what} {name} already; choose another name")


@contextmanager
def named_in_errors(what: str, part: object) -> Iterator[None]:
    """Let an error in code that comes from outside name what it belongs to, and the cure."""
    try:
        yield
    except Exception as error:
        module = str(getattr(part, "__module__", ""))
        if isinstance(error, StickslipError) or module.startswith("stickslip_ros."):
            raise
        raise RegistrationError(
            f"{what} of {module} fails: {type(error).__name__}: {error}; mend it there"
        ) from error


def register_packages() -> None:
    """Register what packages bring; the name of an entry point is its name here.

    One that cannot be loaded is a RegistrationError that names the package.
    """
    for group, (module, register) in ENTRY_POINTS.items():
        for one in entry_points(group=group):
            package = one.dist.name if one.dist else one.value
            try:
                getattr(import_module(module), register)(one.name, one.load())
            except Exception as error:
                raise RegistrationError(
                    f"{one.name} of {package} ({group}) cannot be registered: {error}; "
                    f"mend or uninstall {package}"
                ) from error
