# SPDX-License-Identifier: Apache-2.0
"""Drivers of the simulated axis: in this process, and its node over DDS."""

from __future__ import annotations

import contextlib
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

from stickslip_ros.axis import Axis
from stickslip_ros.axis.state_machine import FAULT, HOLDING
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
_PATIENCE, _POLL = 20.0, 1e-3  # s, for a state


@contextlib.contextmanager
def undone_if_refused(undo: Callable[[], object]) -> Iterator[None]:
    """Undo what went before if this is refused."""
    try:
        yield
    except ValueError:
        undo()
        raise


class _Axis(Driver):
    """What takes the commands of an axis by name, see `stickslip_ros.axis.commands`."""

    _hertz = Driver.frequency

    def command(self, name: str, *arguments: Any) -> None:
        """Carry out a command; ValueError if it is refused."""
        raise NotImplementedError

    def state(self) -> str:
        """Return the state, one of `stickslip_ros.axis.state_machine.STATES`."""
        raise NotImplementedError

    def set_drive(self, amplitude: float, frequency: float) -> None:
        """Set both, none if one is refused."""
        before = self.amplitude_now()
        self.command("amplitude", amplitude)
        with undone_if_refused(lambda: self.command("amplitude", before)):
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
        """End what runs."""
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


class Offline(_Axis):
    """The axis without ROS; its time passes at once."""

    slack = 0.0

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


class OverRos(_Axis):
    """The node of an axis in this process, over DDS, in a domain of its own."""

    slack = 2.0

    def __init__(self) -> None:
        """Start the node and connect to it."""
        from stickslip_ros.ros.in_process import InProcess
        from stickslip_ros.testing.plugin import own_domain

        with contextlib.ExitStack() as stack:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
            environment = stack.enter_context(pytest.MonkeyPatch.context())
            stack.enter_context(own_domain(folder, environment.setenv))
            world = InProcess(folder, PARAMETERS, {})
            stack.callback(world.close)
            self._stack = stack.pop_all()
        (self.client,) = world.clients.values()

    @property
    def position(self) -> float:
        """From the next of joint_states, m: the last one may be of before the last command."""
        heard, end = self.client.stamp, time.monotonic() + _PATIENCE
        asked = time.time()
        while self.client.stamp <= max(heard, asked) and time.monotonic() < end:
            time.sleep(_POLL)
        return self.client.position

    @property
    def moving(self) -> bool:
        """Whether cycles run."""
        return self.client.moving

    def command(self, name: str, *arguments: Any) -> None:
        """Send a command and wait for the answer."""
        self.client.send(name, *arguments)

    def set_parameters(self, **values: float) -> None:
        """Set parameters of the axis."""
        self.client.set_parameters(**values)

    def state(self) -> str:
        """Return the state."""
        return self.client.state

    def amplitude_now(self) -> float:
        """Return the amplitude in force, V."""
        return float(self.client.status["amplitude (V)"])

    @property
    def at_target(self) -> bool:
        """Whether it holds."""
        return self.client.target_reached

    def status(self) -> Mapping[str, Any]:
        """Return the counts."""
        status = self.client.status
        return {"steps": int(status["steps commanded"]), "refused": int(status["refused commands"])}

    def close(self) -> None:
        """End the node."""
        self._stack.close()
