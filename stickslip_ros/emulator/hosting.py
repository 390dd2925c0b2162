# SPDX-License-Identifier: Apache-2.0
"""Runs a server in a program: with its own axes, advanced by the clock, and in a thread."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

from stickslip_ros.axis import Axis, Pace
from stickslip_ros.emulator.dialogue import Controller
from stickslip_ros.emulator.server import TICK_S, Runner, Server


class OwnAxes:
    """Axes in the time that has gone by since `begin`."""

    def __init__(self, axes: Sequence[Axis], clock_ns: Callable[[], int] = time.monotonic_ns):
        """Take axes at time 0; clock_ns: a steady clock (ns)."""
        self.axes = axes
        self._clock_ns = clock_ns
        self._pace = Pace(axes, 0.0, 0, 0, time.thread_time)

    def begin(self) -> None:
        """Start the time, once everything is compiled that commands will need."""
        self.axes[0].compile_ahead()
        self._pace = Pace(self.axes, 1.0, self._clock_ns(), 0, time.thread_time)

    async def run(self, action: Callable[[], Any]) -> Any:
        """Advance the axes to the present, as far as the processor allows, and do an action."""
        self._pace.catch_up(self._clock_ns())
        for axis in self.axes:
            axis.take_events()  # nobody reads them, and they would pile up
        return action()


class ServerThread:
    """A thread that serves a controller until it is closed."""

    def __init__(
        self,
        controller: Controller,
        run: Runner,
        host: str = "127.0.0.1",
        port: int = 0,
        tick_s: float = TICK_S,
    ) -> None:
        """Start to listen, on a free port for 0; arguments as of `Server`. Raises OSError."""
        self._run = run
        self._loop = asyncio.new_event_loop()
        self._server = Server(controller, run, tick_s)
        self._thread = threading.Thread(
            target=self._loop.run_forever, name="stickslip_emulator", daemon=True
        )
        self._thread.start()
        try:
            self.host, self.port = self._wait(self._server.start(host, port))
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> ServerThread:
        """Return itself."""
        return self

    def __exit__(self, *error: object) -> None:
        """Close it."""
        self.close()

    def call(self, action: Callable[[], Any]) -> Any:
        """Carry out an action on the axes, at the present time and between two commands."""
        return self._wait(self._run(action))

    def close(self) -> None:
        """Hang up and end the thread; twice does no harm."""
        if self._loop.is_closed():
            return
        self._wait(self._server.close())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    def _wait(self, work: Any) -> Any:
        return asyncio.run_coroutine_threadsafe(_awaited(work), self._loop).result(60.0)


async def _awaited(work: Any) -> Any:
    return await work
