# SPDX-License-Identifier: Apache-2.0
"""A driver of the simulated axis in this process, and the base class of its other drivers."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from stickslip_ros.axis import Axis
from stickslip_ros.axis.command import FAULT, HOLDING
from stickslip_ros.testing.driver import Driver

#: A drive that all of them can have; the noise of the sensor would only blur what is compared.
PARAMETERS = {
    "gain": 1e-8,
    "max_voltage": 100.0,
    "amplitude": 100.0,
    "frequency": 1000.0,
    "slewrate": 50.0,
    "preload": 1.0,
    "sensor_noise": 0.0,
}
#: Limits of the velocity (m/s): one that any motion passes, one that none does
ANY_MOTION, NO_MOTION = 1e-7, 1.0


@contextlib.contextmanager
def undo_if_refused(undo: Callable[[], object]) -> Iterator[None]:
    """Call undo if a command in the block is refused."""
    try:
        yield
    except ValueError:
        undo()
        raise


class AxisDriver(Driver):
    """A driver that passes commands of an axis by name, see `stickslip_ros.axis.commands`."""

    _hertz = Driver.frequency

    def command(self, name: str, *arguments: Any) -> None:
        """Carry out a command; ValueError if it is refused."""
        raise NotImplementedError

    def state(self) -> str:
        """Return the state, one of `stickslip_ros.axis.command.STATES`."""
        raise NotImplementedError

    def set_drive(self, amplitude: float, frequency: float) -> None:
        """Set both, none if one is refused."""
        before = self.amplitude_now()
        self.command("amplitude", amplitude)
        with undo_if_refused(lambda: self.command("amplitude", before)):
            self.command("frequency", frequency)
        self._hertz = frequency

    def amplitude_now(self) -> float:
        """Return the amplitude in force, V."""
        raise NotImplementedError

    def set_parameters(self, **values: float) -> None:
        """Set parameters of the axis."""
        self.command("parameters", values)

    def step(self, steps: int) -> None:
        """Run steps."""
        self.command("steps", steps)

    def jog(self, sign: int) -> None:
        """Step without end."""
        self.command("jog", sign * self._hertz)

    def stop(self) -> None:
        """End the running command."""
        self.command("stop")

    def move_to(self, x: float) -> None:
        """Go to a position (m)."""
        self.command("position", x)

    @property
    def at_target(self) -> bool:
        """Whether it holds."""
        return self.state() == HOLDING

    def set_limits(self, low: float, high: float) -> None:
        """Set the soft limits (m)."""
        self.set_parameters(soft_low=low, soft_high=high)

    def provoke_fault(self) -> None:
        """Move, where no motion is slow enough."""
        self.set_parameters(max_velocity=ANY_MOTION)
        self.jog(1)

    @property
    def fault(self) -> bool:
        """Whether it is in a fault."""
        return self.state() == FAULT

    def reset(self) -> None:
        """Leave the fault."""
        self.set_parameters(max_velocity=NO_MOTION)
        self.command("reset")


class Offline(AxisDriver):
    """The axis without ROS; its time passes at once."""

    slack = 0.02  # steps begin when a scan that a target ended with is undone

    def __init__(self) -> None:
        """Set up the axis."""
        self.axis = Axis(PARAMETERS)

    @property
    def position(self) -> float:
        """As the simulated sensor reads it, m."""
        return self.axis.status.position

    @property
    def moving(self) -> bool:
        """Whether cycles run."""
        return self.axis.moving

    def command(self, name: str, *arguments: Any) -> None:
        """Carry out a command."""
        self.axis.command(name, *arguments)

    def state(self) -> str:
        """Return the state."""
        return self.axis.mode

    def amplitude_now(self) -> float:
        """Return the amplitude in force, V."""
        return self.axis.status.amplitude

    def status(self) -> Mapping[str, Any]:
        """Return the counts."""
        status = self.axis.status
        return {"steps": status.step_count, "refused": status.refused}

    def now(self) -> float:
        """As simulated, s."""
        return self.axis.state.t

    def pass_time(self, seconds: float) -> None:
        """Advance."""
        self.axis.advance(self.axis.state.t + seconds)
