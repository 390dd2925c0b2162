# SPDX-License-Identifier: Apache-2.0
"""Serves the axes of a process by the protocol of a real controller, besides their topics.

Clients and topics command the same axes: a command of a client is executed between two callbacks of
the executor, in its thread, and becomes an event like any other command.
"""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable
from concurrent.futures import Future, InvalidStateError
from contextlib import suppress
from queue import SimpleQueue
from typing import Any

from stickslip_ros.base.errors import UsageError
from stickslip_ros.emulator import ServerThread, controller_of
from stickslip_ros.ros.nodes.axis_node import AxisNode
from stickslip_ros.ros.nodes.node_parameters import EMULATE_PORT
from stickslip_ros.ros.nodes.process import Runnable

_TICK_S = 0.1  # each takes a round of the executor


class Emulation:
    """Axes that are served as a controller while they run."""

    def __init__(self, axes: Runnable, controller: str, port: int) -> None:
        """Listen on loopback. Raises ParameterError, and UsageError where the port is taken."""
        self._runnable = axes
        self._axes = [node for node in axes.nodes if isinstance(node, AxisNode)]
        self.finished, self.nodes = axes.finished, axes.nodes
        self._waiting = SimpleQueue[tuple[Callable[[], Any], Future[Any]]]()
        made = controller_of(controller, [node.axis for node in self._axes])
        try:
            self._server = ServerThread(made, self._run, port=port, tick_s=_TICK_S)
        except OSError as error:
            raise UsageError(
                f"cannot listen on port {port}: {os.strerror(error.errno or 0)}; choose another "
                f"{EMULATE_PORT.name}, or 0 for a free one"
            ) from None
        self.port = self._server.port
        said = f"{controller} listens on {self._server.host} port {self.port}"
        self.nodes[0].get_logger().info(said)

    def close(self) -> None:
        """Hang up and let the axes finish."""
        self._server.close()
        self._runnable.close()

    # -- inside

    async def _run(self, action: Callable[[], Any]) -> Any:
        """Have the executor carry out an action; called in the thread of the server."""
        answer: Future[Any] = Future()
        self._waiting.put((action, answer))
        # Not a guard condition: the executor of events has none. Without an executor, before the
        # nodes are spun, the next tick carries it out.
        if executor := self.nodes[0].executor:
            executor.create_task(self._carry_out)
        return await asyncio.wrap_future(answer)

    def _carry_out(self) -> None:
        """Execute the commands that wait now; a flood of later ones leaves time for the axes."""
        for _ in range(self._waiting.qsize()):
            action, answer = self._waiting.get()
            with suppress(InvalidStateError):  # the client has gone
                try:
                    for node in self._axes:
                        node.sim_loop.act(node)
                    answer.set_result(action())
                except Exception as failure:  # ends that client, not the axes
                    answer.set_exception(failure)
        for node in self._axes:
            node.publish_events()
