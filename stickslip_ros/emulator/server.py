# SPDX-License-Identifier: Apache-2.0
"""Serves a controller over TCP to several clients at once, within bounds.

Whatever clients send, the server keeps one unfinished line and one unread answer of each, and no
more clients than its limit. A client that does not read its answers is not read from either.

`OwnAxes` and `ServerThread` run it in a program: with axes advanced by the clock, and in a thread.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import threading
import time
from collections.abc import Awaitable, Callable, Sequence
from typing import Any, NoReturn

from stickslip_ros.axis import Axis, Pace
from stickslip_ros.axis.pace import overload
from stickslip_ros.emulator.controller import Controller, Dialogue, Waiting

#: Carries out an action in the thread that owns the axes, which are at the present time then.
Runner = Callable[[Callable[[], Any]], Awaitable[Any]]

MOST_CLIENTS = 256
_CHUNK = 4096  # bytes that are read in one go
_UNREAD = 16384  # bytes of answers that may wait for the client
_STALL_S = 30.0  # that a client may take to read them
TICK_S = 0.02  # between looks at what is due without a command
_LOOK_NS = 1_000_000_000  # between looks at how time goes
_WARN_NS = 10_000_000_000  # between warnings that it is dropped
_POLL_S = 0.005  # between looks at what a client waits for


class Server:
    """A controller on a TCP port."""

    def __init__(
        self,
        controller: Controller,
        run: Runner,
        tick_s: float = TICK_S,
        most_clients: int = MOST_CLIENTS,
    ) -> None:
        """Serve a controller whose axes belong to the thread that ``run`` carries actions to."""
        self._controller = controller
        self._run = run
        self._tick_s = tick_s
        self._most = most_clients
        self._clients: set[asyncio.Task[Any]] = set()
        self._talks: dict[Dialogue, asyncio.StreamWriter] = {}
        self._server: asyncio.Server | None = None
        self._ticker: asyncio.Task[NoReturn] | None = None

    async def start(self, host: str, port: int) -> tuple[str, int]:
        """Listen; return host and port, which is a free one for port 0. Raises OSError."""
        self._server = await asyncio.start_server(self._meet, host, port, limit=_CHUNK, backlog=512)
        self._ticker = asyncio.create_task(self._tick())
        address = self._server.sockets[0].getsockname()
        return str(address[0]), int(address[1])

    async def failed(self) -> NoReturn:
        """Return when the axes cannot be advanced any more, with the exception of that."""
        assert self._ticker
        await asyncio.shield(self._ticker)

    async def close(self) -> None:
        """Hang up; twice does no harm."""
        if self._server:
            self._server.close()
        for task in [*self._clients, *filter(None, [self._ticker])]:
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError, Exception):
                await task

    # -- inside

    async def _tick(self) -> NoReturn:
        while True:
            for dialogue, news in await self._run(self._work):
                writer = self._talks.get(dialogue)
                if writer and not (writer.is_closing() or _is_behind(writer)):
                    writer.write(news)
            await asyncio.sleep(self._tick_s)

    def _work(self) -> list[tuple[Dialogue, bytes]]:
        """Do what is due without a command; return what clients are told without asking."""
        self._controller.tick()
        found = [(dialogue, dialogue.news()) for dialogue in list(self._talks)]
        return [one for one in found if one[1]]

    async def _meet(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task
        try:
            if len(self._clients) < self._most:
                self._clients.add(task)
                writer.transport.set_write_buffer_limits(high=_UNREAD)
                dialogue = self._controller.connect()
                self._talks[dialogue] = writer
                try:
                    await self._talk(dialogue, reader, writer)
                finally:
                    del self._talks[dialogue]
                    self._controller.disconnect(dialogue)
        except (TimeoutError, ConnectionError):
            pass  # gone, silent for too long, or too slow to read
        except asyncio.CancelledError:
            pass  # the server closes; asyncio would log a task that ends like this
        finally:
            self._clients.discard(task)
            # What a client has not read for so long is not worth waiting for.
            (writer.transport.abort if _is_behind(writer) else writer.close)()

    async def _talk(
        self, dialogue: Dialogue, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        lines = dialogue.cutter()
        writer.write(dialogue.greeting)
        while not dialogue.over():
            data = await asyncio.wait_for(reader.read(_CHUNK), dialogue.patience)
            if not data:
                return
            for line in lines.take(data):
                answer = await self._answer(dialogue, line, reader)
                if writer.is_closing():  # asyncio would log each write to a client that has gone
                    return
                writer.write(answer)
                if dialogue.over():
                    return
                if _is_behind(writer):
                    await asyncio.wait_for(writer.drain(), _STALL_S)
                await asyncio.sleep(0)  # the others' turn

    async def _answer(
        self, dialogue: Dialogue, line: bytes | None, reader: asyncio.StreamReader
    ) -> bytes:
        answer = await self._run(lambda: self._controller.hear(dialogue, line))
        if not isinstance(answer, Waiting):
            return bytes(answer)
        while not await self._run(answer.done):
            if reader.at_eof() or reader.exception():
                raise ConnectionResetError
            await asyncio.sleep(_POLL_S)
        return bytes(await self._run(answer.answer))


def _is_behind(writer: asyncio.StreamWriter) -> bool:
    return writer.transport.get_write_buffer_size() > _UNREAD


class OwnAxes:
    """Axes in the time that has gone by since `begin`."""

    def __init__(self, axes: Sequence[Axis], clock_ns: Callable[[], int] = time.monotonic_ns):
        """Take axes at time 0; clock_ns: a steady clock (ns)."""
        self.axes = axes
        self.forgets = True  #: what happens to the axes; off where somebody records it
        self.late = ""  #: how much time was dropped lately, and why; empty if none was
        self._clock_ns = clock_ns
        self._pace: Pace | None = None
        self._told, self._asked = -_WARN_NS, 0  # ns, of the last warning and of the last look

    def begin(self) -> None:
        """Start the time, once everything is compiled that commands will need.

        The first `run` does it, too; a client that has connected before waits for the compilation.
        """
        self.axes[0].compile_ahead()
        self._pace = Pace(self.axes, 1.0, self._clock_ns(), 0, time.thread_time)

    async def run(self, action: Callable[[], Any]) -> Any:
        """Advance the axes to the present, as far as the processor allows, and do an action."""
        if not self._pace:
            self.begin()
        assert self._pace
        self._pace.catch_up(now := self._clock_ns())
        if now - self._asked > _LOOK_NS:
            self._asked, report = now, self._pace.report(now)
            moving = next((axis for axis in self.axes if axis.moving), self.axes[0])
            self.late = overload(moving, report)
            if self.late and now - self._told > _WARN_NS:
                self._told = now
                logging.getLogger(__name__).warning("time is dropped, %s", self.late)
        if self.forgets:
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
