# SPDX-License-Identifier: Apache-2.0
"""Commands for every axis in the graph."""

from __future__ import annotations

import time

from rclpy.client import Client
from rclpy.node import Node
from rclpy.task import Future

from stickslip_ros.axis.command import Command
from stickslip_ros.ros.nodes.messages import message_class, write_command
from stickslip_ros.ros.nodes.process import SpinThread
from stickslip_ros.ros.nodes.topics import axes_in

_LOOK = 0.01  # s between looks for axes and answers
_QUIET = 1.0  # s without another axis, after which all are known


def command_all(command: Command, timeout: float) -> dict[str, str]:
    """Call a service without values of every axis, each as soon as it is found.

    Returns why it did not do so for each full name of an axis, which is empty where it did; nothing
    where no axis is found within the timeout (s), which applies to the answers as well.
    """
    spin = SpinThread("stickslip_everywhere")
    try:
        node = spin.add(Node("stickslip_everywhere", context=spin.context, enable_rosout=False))
        kind = message_class(command.type)
        clients: dict[str, Client] = {}
        calls: dict[str, Future] = {}
        began = found = time.monotonic()
        while (now := time.monotonic()) < began + timeout:
            for axis in axes_in(node):
                if axis not in clients:
                    clients[axis] = node.create_client(kind, f"{axis}/{command.interface}")
                    found = now
            for axis, client in clients.items():
                if axis not in calls and client.service_is_ready():
                    calls[axis] = client.call_async(write_command(command))
            done = [axis for axis, call in calls.items() if call.done()]
            if clients and len(done) == len(clients) and now > found + _QUIET:
                break
            time.sleep(_LOOK)
        silent = f"it does not answer (waited {timeout:g} s)"
        answers = {axis: call.result() for axis, call in calls.items() if call.done()}
        reasons = {axis: "" if one.success else one.message for axis, one in answers.items()}
        return {axis: reasons.get(axis, silent) for axis in clients}
    finally:
        spin.close()
