# SPDX-License-Identifier: Apache-2.0
"""A node for programs that have none."""

from __future__ import annotations

import atexit
import contextlib
import threading

import rclpy
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node


class SpinningNode:
    """A node with a context and a thread of its own."""

    def __init__(self) -> None:
        """Make it and spin it."""
        context = Context()
        rclpy.init(context=context)
        # It logs nothing, and a second one of that name would be warned of.
        self.node = Node("stickslip_client", context=context, enable_rosout=False)
        self._executor = SingleThreadedExecutor(context=context)
        self._executor.add_node(self.node)
        self._ending = False
        self._thread = threading.Thread(target=self._spin, name="stickslip_client", daemon=True)
        self._thread.start()
        # A program that ends without closing would be aborted in the middle of a wait.
        atexit.register(self.close)

    def _spin(self) -> None:
        with contextlib.suppress(ExternalShutdownException):
            # Shut down in the middle of `spin`, the executor falls over what it waits for.
            while not self._ending:
                self._executor.spin_once(timeout_sec=1.0)

    def close(self) -> None:
        """End all of it; twice does no harm."""
        if self._ending:
            return
        self._ending = True
        atexit.unregister(self.close)
        self._executor.wake()
        self._thread.join()
        self._executor.shutdown()
        self.node.destroy_node()
        self.node.context.try_shutdown()
