# SPDX-License-Identifier: Apache-2.0
"""Drivers of the simulated axis: its node over DDS, and behind the emulated controllers."""

import contextlib
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest
from emulated import Emulated

from stickslip_ros.axis import Axis
from stickslip_ros.testing.axis_drivers import PARAMETERS, AxisDriver, undo_if_refused
from stickslip_ros.testing.driver import Driver
from stickslip_ros.testing.plugin import own_domain

_PATIENCE, _POLL = 20.0, 1e-3  # s, for a state


class OverRos(AxisDriver):
    """The node of an axis in this process, over DDS, in a domain of its own."""

    slack = 2.0

    def __init__(self) -> None:
        """Start the node and connect to it."""
        from stickslip_ros.ros.in_process import InProcess  # where there is ROS

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
        return self.client.moving

    def command(self, name: str, *arguments: Any) -> None:
        """Send a command and wait for the answer."""
        self.client.send(name, *arguments)

    def set_parameters(self, **values: float) -> None:
        self.client.set_parameters(**values)

    def state(self) -> str:
        return self.client.state

    def amplitude_now(self) -> float:
        """Return the amplitude in force, V."""
        return float(self.client.status["amplitude (V)"])

    @property
    def at_target(self) -> bool:
        return self.client.target_reached

    def status(self) -> Mapping[str, Any]:
        status = self.client.status
        return {"steps": int(status["steps commanded"]), "refused": int(status["refused commands"])}

    def close(self) -> None:
        self._stack.close()


class _Emulated(Driver):
    """A controller over TCP; what its protocol does not report, an interferometer does."""

    controller = ""

    def __init__(self) -> None:
        """Serve it on a free port and connect to that."""
        self.axis = Axis(PARAMETERS)
        self._emulated = Emulated(self.controller, [self.axis])
        self._client = self._emulated.client()

    def look(self, what: Callable[[], Any]) -> Any:
        """Return something of the axis at the present time."""
        return self._emulated.look(what)

    @property
    def position(self) -> float:
        """By the interferometer, m."""
        return float(self.look(lambda: self.axis.state.x))

    @property
    def moving(self) -> bool:
        """Whether cycles run, as the output shows it."""
        return bool(self.look(lambda: self.axis.moving))

    def close(self) -> None:
        """Hang up and end the server."""
        self._client.close()
        self._emulated.server.close()


class EmulatedAnc300(_Emulated):
    """The console of an ANC300."""

    controller = "anc300"

    def __init__(self) -> None:
        """Log in and connect the axis to the stepping generator."""
        super().__init__()
        self._client.send(b"123456\r\necho off\r\n")
        self._client.until(b"OK\r\n")
        self.ask("setm 1 stp")

    def ask(self, line: str) -> str:
        """Send a line and return the answer; ValueError if that ends with ERROR."""
        said = ""
        part = self._client.ask(line)
        while part not in ("OK\r", "ERROR\r"):
            said += part
            part = self._client.until(b"\n").decode().removesuffix("\n")
        if part == "ERROR\r":
            raise ValueError(said)
        return said

    def set_drive(self, amplitude: float, frequency: float) -> None:
        """Set both, none if one is refused."""
        before = self.ask("getv 1").split()[2]
        self.ask(f"setv 1 {amplitude}")
        with undo_if_refused(lambda: self.ask(f"setv 1 {before}")):
            self.ask(f"setf 1 {frequency}")

    def step(self, steps: int) -> None:
        self.ask(f"step{'u' if steps > 0 else 'd'} 1 {abs(steps)}")

    def jog(self, sign: int) -> None:
        self.ask(f"step{'u' if sign > 0 else 'd'} 1 c")

    def stop(self) -> None:
        self.ask("stop 1")
