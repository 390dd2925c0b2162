# SPDX-License-Identifier: Apache-2.0
"""Serves a controller over TCP to several clients at once, within bounds.

Whatever clients send, the server keeps one unfinished line and one unread answer of each, and no
more clients than its limit. A client that does not read its answers is not read from either.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Awaitable, Callable
from typing import Any, NoReturn

from stickslip_ros.emulator.dialogue import Controller, Dialogue, Lines, Waiting

#: Carries out an action in the thread that owns the axes, which are at the present time then.
Runner = Callable[[Callable[[], Any]], Awaitable[Any]]

MOST_CLIENTS = 256
LONGEST_LINE = 4096  # bytes; a pattern of 256 numbers takes a thousand
_CHUNK = 4096  # bytes that are read in one go
_UNREAD = 16384  # bytes of answers that may wait for the client
_STALL_S = 30.0  # that a client may take to read them
TICK_S = 0.02  # between looks at what is due without a command
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
            await self._run(self._controller.tick)
            await asyncio.sleep(self._tick_s)

    async def _meet(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task
        try:
            if len(self._clients) < self._most:
                self._clients.add(task)
                writer.transport.set_write_buffer_limits(high=_UNREAD)
                await self._talk(self._controller.connect(), reader, writer)
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
        lines = Lines(LONGEST_LINE)
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
        answer = await self._run(lambda: dialogue.answer(line))
        if not isinstance(answer, Waiting):
            return bytes(answer)
        while not await self._run(answer.done):
            if reader.at_eof() or reader.exception():
                raise ConnectionResetError
            await asyncio.sleep(_POLL_S)
        return bytes(await self._run(answer.answer))


def _is_behind(writer: asyncio.StreamWriter) -> bool:
    return writer.transport.get_write_buffer_size() > _UNREAD
