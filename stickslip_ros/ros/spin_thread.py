# SPDX-License-Identifier: Apache-2.0
"""A context with an executor that spins in a thread, for programs that do something else."""

from __future__ import annotations

import atexit
import threading
import traceback
from typing import TypeVar

import rclpy
from rclpy.context import Context
from rclpy.exceptions import InvalidHandle
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.logging import get_logger
from rclpy.node import Node

N = TypeVar("N", bound=Node)
_WARN_PERIOD = 1.0  # s, between errors in the log


class SpinThread:
    """Spins the given nodes until it is closed; then they are destroyed.

    An exception in a callback is logged and does not end the thread, which all nodes need.
    """

    def __init__(self, name: str = "stickslip_spin", domain_id: int | None = None) -> None:
        """Start; name is that of the thread, domain_id None for that of the environment."""
        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain_id)
        self.executor = SingleThreadedExecutor(context=self.context)
        self._nodes: list[Node] = []
        self._ending = False
        self._thread = threading.Thread(target=self._spin, name=name, daemon=True)
        self._thread.start()
        # A program that ends without closing would be aborted in the middle of a wait.
        atexit.register(self.close)

    def add(self, node: N) -> N:
        """Spin a node made with :attr:`context` and destroy it at the end; return it."""
        self._nodes.append(node)
        self.executor.add_node(node)
        return node

    def close(self) -> None:
        """End all of it; twice does no harm."""
        if self._ending:
            return
        self._ending = True
        atexit.unregister(self.close)
        self.executor.create_task(lambda: None)  # a round ends with work, not because it was woken
        self._thread.join()
        self.executor.shutdown()
        for node in self._nodes:
            node.destroy_node()
        self.context.try_shutdown()

    def _spin(self) -> None:
        # Shut down in the middle of `spin`, the executor falls over what it waits for.
        while not self._ending:
            try:
                self.executor.spin_once(timeout_sec=1.0)
            except ExternalShutdownException:
                return
            except InvalidHandle:
                # Another thread destroyed something that the executor was about to wait for.
                continue
            except Exception:
                # Otherwise no node would receive messages any more, and callers would wait in vain.
                get_logger(self._thread.name).error(
                    f"passed over, the thread goes on:\n{traceback.format_exc()}",
                    throttle_duration_sec=_WARN_PERIOD,
                )
