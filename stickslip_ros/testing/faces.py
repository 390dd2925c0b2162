# SPDX-License-Identifier: Apache-2.0
"""Drivers of the simulated axis: in this process, its node over DDS, the emulated controllers."""

from __future__ import annotations

import contextlib
import math
import socket
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from stickslip_ros.axis import Axis
from stickslip_ros.axis.state_machine import FAULT, HOLDING
from stickslip_ros.emulator import OwnAxes, ServerThread, controller_of
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
_ANY_MOTION, _NO_MOTION = 1e-7, 1.0  # m/s, limits of the velocity
_PATIENCE, _POLL = 20.0, 1e-3  # s, for a state


class Offline(Driver):
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

    def set_drive(self, amplitude: float, frequency: float) -> None:
        """Set both, none if one is refused."""
        before = self.axis.status.amplitude
        self.axis.command_amplitude(amplitude)
        try:
            self.axis.command_frequency(frequency)
        except ValueError:
            self.axis.command_amplitude(before)
            raise

    def step(self, steps: int) -> None:
        """Run steps."""
        self.axis.command_steps(steps)

    def jog(self, sign: int) -> None:
        """Step without end."""
        self.axis.command_jog(sign * self.axis.status.frequency)

    def stop(self) -> None:
        """End what runs."""
        self.axis.stop()

    def move_to(self, x: float) -> None:
        """Go to a position (m)."""
        self.axis.command_position(x)

    @property
    def at_target(self) -> bool:
        """Whether it holds."""
        return self.axis.mode == HOLDING

    def set_limits(self, low: float, high: float) -> None:
        """Set the soft limits (m)."""
        self.axis.set_parameters({"soft_low": low, "soft_high": high})

    def provoke_fault(self) -> None:
        """Move, where no motion is slow enough."""
        self.axis.set_parameters({"max_velocity": _ANY_MOTION})
        self.jog(1)

    @property
    def fault(self) -> bool:
        """Whether it is in a fault."""
        return self.axis.mode == FAULT

    def reset(self) -> None:
        """Leave the fault."""
        self.axis.set_parameters({"max_velocity": _NO_MOTION})
        self.axis.reset()

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


class OverRos(Driver):
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
        self._hertz = self.frequency

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

    def set_drive(self, amplitude: float, frequency: float) -> None:
        """Set both, none if one is refused."""
        before = float(self.client.status["amplitude (V)"])
        self.client.set_amplitude(amplitude)
        try:
            self.client.set_frequency(frequency)
        except ValueError:
            self.client.set_amplitude(before)
            raise
        self._hertz = frequency

    def step(self, steps: int) -> None:
        """Run steps."""
        self.client.step(steps)

    def jog(self, sign: int) -> None:
        """Step without end."""
        self.client.jog(sign * self._hertz)

    def stop(self) -> None:
        """End what runs."""
        self.client.stop()

    def move_to(self, x: float) -> None:
        """Go to a position (m)."""
        self.client.move_to(x)

    @property
    def at_target(self) -> bool:
        """Whether it holds."""
        return self.client.target_reached

    def set_limits(self, low: float, high: float) -> None:
        """Set the soft limits (m)."""
        self.client.set_parameters(soft_low=low, soft_high=high)

    def provoke_fault(self) -> None:
        """Move, where no motion is slow enough."""
        self.client.set_parameters(max_velocity=_ANY_MOTION)
        self.jog(1)

    @property
    def fault(self) -> bool:
        """Whether it is in a fault."""
        return self.client.state == FAULT

    def reset(self) -> None:
        """Leave the fault."""
        self.client.set_parameters(max_velocity=_NO_MOTION)
        self.client.reset()

    def status(self) -> Mapping[str, Any]:
        """Return the counts."""
        status = self.client.status
        return {"steps": int(status["steps commanded"]), "refused": int(status["refused commands"])}

    def close(self) -> None:
        """End the node."""
        self._stack.close()


class _Emulated(Driver):
    """A controller over TCP; what its protocol does not report, an interferometer does."""

    controller = ""

    def __init__(self) -> None:
        """Serve it on a free port and connect to that."""
        self.axis = Axis(PARAMETERS)
        own = OwnAxes([self.axis])
        own.begin()
        self._server = ServerThread(controller_of(self.controller, own.axes), own.run)
        self._client = socket.create_connection(("127.0.0.1", self._server.port), 20.0)
        self._answers = self._client.makefile("rb")

    def look(self, what: Callable[[], Any]) -> Any:
        """Return something of the axis at the present time."""
        return self._server.call(what)

    def tell(self, line: str) -> None:
        """Send a line."""
        self._client.sendall(line.encode() + b"\r\n")

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
        self._answers.close()
        self._client.close()
        self._server.close()


class EmulatedAnc300(_Emulated):
    """The console of an ANC300."""

    controller = "anc300"

    def __init__(self) -> None:
        """Log in and connect the axis to the stepping generator."""
        super().__init__()
        self.tell("123456")
        self.ask("echo off")
        self.ask("setm 1 stp")

    def ask(self, line: str) -> str:
        """Send a line and return the answer; ValueError if that ends with ERROR."""
        self.tell(line)
        said = ""
        while True:
            part = self._answers.readline().decode("latin-1")
            if part == "OK\r\n":
                return said
            if part == "ERROR\r\n":
                raise ValueError(said)
            said += part

    def set_drive(self, amplitude: float, frequency: float) -> None:
        """Set both, none if one is refused."""
        before = self.ask("getv 1").split()[2]
        self.ask(f"setv 1 {amplitude}")
        try:
            self.ask(f"setf 1 {frequency}")
        except ValueError:
            self.ask(f"setv 1 {before}")
            raise

    def step(self, steps: int) -> None:
        """Run steps."""
        self.ask(f"step{'u' if steps > 0 else 'd'} 1 {abs(steps)}")

    def jog(self, sign: int) -> None:
        """Step without end."""
        self.ask(f"step{'u' if sign > 0 else 'd'} 1 c")

    def stop(self) -> None:
        """End what runs."""
        self.ask("stop 1")


class EmulatedMcs2(_Emulated):
    """The SCPI interface of an MCS2."""

    controller = "mcs2"
    _LEVELS, _MOST_STEPS = 65535, 100000

    def __init__(self) -> None:
        """Hold targets without end."""
        super().__init__()
        self._refused = 0
        self.write(":CHAN0:HOLD -1")

    def ask(self, line: str) -> str:
        """Send a question and return the answer."""
        self.tell(line)
        return self._answers.readline().decode().strip()

    def write(self, line: str) -> None:
        """Send a command; ValueError with the error that it leaves."""
        self.tell(line)
        error = self.ask(":SYST:ERR?")
        if not error.startswith("0,"):
            self._refused += 1
            raise ValueError(error)

    @property
    def position(self) -> float:
        """As the controller reads it, m."""
        return 1e-12 * int(self.ask(":CHAN0:POS?"))

    @property
    def moving(self) -> bool:
        """Whether it moves."""
        return bool(int(self.ask(":CHAN0:STAT?")) & 0x1)

    def set_drive(self, amplitude: float, frequency: float) -> None:
        """Set both, none if one is refused."""
        before = self.ask(":CHAN0:STEP:AMPL?")
        level = amplitude * self._LEVELS / 100.0
        self.write(f":CHAN0:STEP:AMPL {level if math.isnan(level) else round(level)}")
        try:
            self.write(f":CHAN0:STEP:FREQ {frequency:g}")
        except ValueError:
            self.write(f":CHAN0:STEP:AMPL {before}")
            raise

    def step(self, steps: int) -> None:
        """Run steps."""
        self.write(":CHAN0:MMOD 4")
        self.write(f":MOVE0 {steps}")

    def jog(self, sign: int) -> None:
        """Run as many steps as a command can have."""
        self.step(sign * self._MOST_STEPS)

    def stop(self) -> None:
        """End what runs."""
        self.write(":STOP0")

    def move_to(self, x: float) -> None:
        """Go to a position (m)."""
        self.write(":CHAN0:MMOD 0")
        self.write(f":MOVE0 {round(1e12 * x)}")

    @property
    def at_target(self) -> bool:
        """Whether the loop is closed and nothing moves."""
        return int(self.ask(":CHAN0:STAT?")) & 0x3 == 0x2

    def set_limits(self, low: float, high: float) -> None:
        """Set the range (m)."""
        self.write(f":CHAN0:RLIM:MIN {round(1e12 * low)}")
        self.write(f":CHAN0:RLIM:MAX {round(1e12 * high)}")

    def provoke_fault(self) -> None:
        """Move, where no motion is slow enough."""
        self.look(lambda: self.axis.set_parameters({"max_velocity": _ANY_MOTION}))
        self.jog(1)

    @property
    def fault(self) -> bool:
        """Whether a movement failed."""
        return bool(int(self.ask(":CHAN0:STAT?")) & 0x800)

    def reset(self) -> None:
        """Switch the amplifier on."""
        self.look(lambda: self.axis.set_parameters({"max_velocity": _NO_MOTION}))
        self.write(":CHAN0:AMPL 1")

    def status(self) -> Mapping[str, Any]:
        """Return the counts: steps by the interferometer, refusals by the errors so far."""
        return {"steps": self.look(lambda: self.axis.status.step_count), "refused": self._refused}
