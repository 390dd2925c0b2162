# SPDX-License-Identifier: Apache-2.0
"""Brings the laws and waveforms that others registered to workers in other processes.

They are registered before the solver is loaded, which is compiled with them. A worker whose solver
is loaded already answers with the error and goes on: one that failed to unpack its task would hang.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from stickslip_ros.physics.laws import Law, RegistrationError, register_law
from stickslip_ros.physics.parameters import Parameters
from stickslip_ros.physics.waveforms import register_waveform


def sweep_with(
    kind: Callable[..., Any],
    laws: Mapping[str, Law],
    waveforms: Mapping[str, Callable[..., Any]],
    flat: Mapping[str, Any],
    *parts: Any,
) -> Any:
    """Register laws and waveforms; return a sweep of a kind, of flat parameters and other parts."""
    try:
        for name, law in laws.items():
            register_law(name, law)
        for name, waveform in waveforms.items():
            register_waveform(name, waveform)
    except RegistrationError as error:
        return Refused(str(error))
    return kind(Parameters.of(flat), *parts)


class Refused:
    """In place of a sweep that a worker cannot compute."""

    def __init__(self, why: str) -> None:
        """Say why."""
        self._why = why

    def evaluate(self, first: int, stop: int) -> Any:
        """Raise RegistrationError."""
        raise RegistrationError(f"in a worker: {self._why}; or start the workers anew")
