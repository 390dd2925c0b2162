# SPDX-License-Identifier: Apache-2.0
"""The registry of waveforms.

A new one of ours is a file beside these and a line in `WAVEFORMS`; one of somebody else's comes in
by `register_waveform`, or by a package that names it in the entry point group
``stickslip_ros.waveforms``.

A waveform is arithmetic on parameters, written once for an operating point and for columns of many:
numbers in the parameters may be arrays. The constants that only this waveform has are
its rows: a frozen dataclass in the attribute ``rows`` of the function, see `with_rows`.

This room loads neither numba nor numpy, because the table of parameters needs it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from stickslip_ros.physics.parameters import DriveParameters, register
from stickslip_ros.physics.parameters.extensions import RegistrationError, check_name
from stickslip_ros.physics.waveforms.built_in import (
    Shape,
    hold_shape,
    sawtooth_shape,
    shaped_shape,
    triangle_shape,
    with_rows,
)
from stickslip_ros.physics.waveforms.table import table_shape

_KNOWN: dict[str, Callable[[DriveParameters], Shape]] = {
    "sawtooth": sawtooth_shape,
    "hold": hold_shape,
    "shaped": shaped_shape,
    "triangle": triangle_shape,
    "table": table_shape,
}

_BUILT_IN = frozenset(_KNOWN)
#: Waveforms by the name that the parameter ``waveform`` takes.
WAVEFORMS: Mapping[str, Callable[[DriveParameters], Shape]] = _KNOWN


def register_waveform(name: str, waveform: Callable[[DriveParameters], Shape]) -> None:
    """Let the parameter ``waveform`` take one of your own, in this process.

    Parameters
    ----------
    name : str
        Its name, a small word.
    waveform : callable
        From the drive's parameters to the `Shape` of a cycle; constants that only it has come with
        the decorator `with_rows`.

    Raises
    ------
    RegistrationError
        For a name that is taken, or what cannot be called.
    """
    check_name(name, "waveform", name in _BUILT_IN, WAVEFORMS)
    if not callable(waveform):
        raise RegistrationError(
            f"{name} is {waveform!r}; give a function of the drive's parameters that returns a "
            "stickslip_ros.Shape"
        )
    _KNOWN[name] = waveform
    if hasattr(waveform, "rows"):
        register("drive", waveform.rows)


for _waveform in WAVEFORMS.values():
    if hasattr(_waveform, "rows"):
        register("drive", _waveform.rows)


def of_others() -> dict[str, Callable[[DriveParameters], Shape]]:
    """Return the waveforms that are not ours, by their names."""
    return {name: one for name, one in WAVEFORMS.items() if name not in _BUILT_IN}


__all__ = [
    "WAVEFORMS",
    "RegistrationError",
    "Shape",
    "register_waveform",
    "with_rows",
]
