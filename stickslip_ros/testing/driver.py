# SPDX-License-Identifier: Apache-2.0
"""The driver interface of the contract tests, and how they find your driver."""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable, Mapping
from importlib.metadata import entry_points
from typing import Any, cast

import pytest

GROUP = "stickslip_ros.drivers"  #: of entry points
#: What the contract tests if nothing is said: the simulated axis in this process
_OFFLINE = {"offline": "stickslip_ros.testing.axis_drivers:Offline"}


class Unsupported(pytest.skip.Exception):  # type: ignore[name-defined, misc]
    """Raised by a driver whose device cannot do something: the test of it is skipped."""


class Driver:
    """A driver of one axis. Subclass it, and do not override what your device cannot do.

    Commands raise ValueError, with the reason, when the device refuses them, and return when it
    has taken them, not when the motion ends.
    """

    amplitude = 100.0  #: V, at which the axis steps well
    frequency = 1000.0  #: Hz, likewise; half of it has to be possible too
    tolerance = 2e-8  #: m, of the closed loop and of standing still
    slack = 0.5  #: s extra time that is allowed for the device and its connection

    # -- what every driver can

    @property
    def position(self) -> float:
        """Where the axis is, m, by the best sensor there is."""
        raise NotImplementedError

    @property
    def moving(self) -> bool:
        """Whether steps run."""
        raise NotImplementedError

    def set_drive(self, amplitude: float, frequency: float) -> None:
        """Set amplitude (V) and frequency (Hz) of later commands."""
        raise NotImplementedError

    def step(self, steps: int) -> None:
        """Run steps, the sign is the direction; they replace the running command."""
        raise NotImplementedError

    def jog(self, sign: int) -> None:
        """Step without end in the direction of the sign."""
        raise NotImplementedError

    def stop(self) -> None:
        """End the running command."""
        raise NotImplementedError

    # -- what some can

    def move_to(self, x: float) -> None:
        """Go to a position (m) in closed loop and hold it."""
        raise Unsupported("no closed loop")

    @property
    def at_target(self) -> bool:
        """Whether the closed loop holds its target."""
        raise Unsupported("no closed loop")

    def set_limits(self, low: float, high: float) -> None:
        """Set the positions (m) that the axis must not pass."""
        raise Unsupported("no limits")

    def provoke_fault(self) -> None:
        """Bring the device into a fault, as by a limit of the velocity that any motion passes."""
        raise Unsupported("no faults")

    @property
    def fault(self) -> bool:
        """Whether the device is in a fault."""
        raise Unsupported("no faults")

    def reset(self) -> None:
        """Leave a fault, with the reason for it taken away."""
        raise Unsupported("no faults")

    def status(self) -> Mapping[str, Any]:
        """Return ``steps`` (net count since the start) and ``refused`` (count), if it has them."""
        raise Unsupported("no diagnostics")

    # -- around it

    def now(self) -> float:
        """Return the time (s) of the device, from any beginning."""
        return time.monotonic()

    def pass_time(self, seconds: float) -> None:
        """Let time go by."""
        time.sleep(seconds)

    def close(self) -> None:
        """Let go of the device, at rest."""


def driver_named(name: str) -> Driver:
    """Make the driver of a name: of an entry point, ours, or ``module:factory``.

    Raises pytest.UsageError where there is none, or the device does not answer.
    """
    try:
        return _make(_factory_named(name), name)
    except (ImportError, AttributeError, OSError) as error:
        raise pytest.UsageError(f"--stickslip-driver {name}: {error}") from error


def _factory_named(name: str) -> Callable[[], Driver]:
    for entry in entry_points(group=GROUP):
        if entry.name == name:
            return cast("Callable[[], Driver]", entry.load())
    module, colon, factory = _OFFLINE.get(name, name).partition(":")
    if not colon:
        known = sorted({*_OFFLINE, *(entry.name for entry in entry_points(group=GROUP))})
        raise pytest.UsageError(
            f"--stickslip-driver {name}: no driver has that name; give module:factory, or one of "
            f"{', '.join(known)}"
        )
    return cast("Callable[[], Driver]", getattr(importlib.import_module(module), factory))


def _make(factory: Callable[[], Driver], name: str) -> Driver:
    driver = factory()
    if not isinstance(driver, Driver):
        raise pytest.UsageError(
            f"--stickslip-driver {name} makes a {type(driver).__name__}; "
            f"subclass {Driver.__module__}.Driver"
        )
    return driver
