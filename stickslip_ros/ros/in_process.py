# SPDX-License-Identifier: Apache-2.0
"""Axes that run in this process, with a client for each, for tests.

They work as in a process of `axis_node`, except for their own context.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rclpy.node import Node

from stickslip_ros.parameters.groups import AXIS_NODE
from stickslip_ros.ros.axis_host import axis_or_host
from stickslip_ros.ros.axis_node import AxisNode
from stickslip_ros.ros.client import AxisClient
from stickslip_ros.ros.emulation import Emulation
from stickslip_ros.ros.process import SpinThread


class InProcess:
    """Axes, their clients, and the executor that spins them and nodes of yours."""

    def __init__(
        self, folder: Path, parameters: Mapping[str, Any], of_axes: Mapping[str, Mapping[str, Any]]
    ) -> None:
        """Start the axes.

        parameters are those of the node, or of the host and all its axes; of_axes are those of
        each axis by its name, none for a single axis; folder is where a parameter file is put.
        Raises ParameterError.
        """
        single = not of_axes
        common = dict(parameters) if single else {**parameters, "axes": list(of_axes)}
        file = folder / "axes.yaml"
        sections = {AXIS_NODE: common, **of_axes}
        content = {name: {"ros__parameters": dict(p)} for name, p in sections.items() if p}
        # JSON is YAML with every text in quotes: ROS reads a bare y, n, on and off as yes and no.
        file.write_text(json.dumps(content), encoding="utf-8")
        arguments = ["--ros-args", "--params-file", str(file)] if common else ["--ros-args"]
        self._spin = SpinThread("stickslip_in_process")
        try:
            self._axes = axis_or_host(
                arguments=arguments,
                context=self._spin.context,
                cli_args=arguments,
                use_global_arguments=False,
            )
            for node in self._axes.nodes:
                self._spin.add(node)
            client = self.node("stickslip_test_client")
            self.nodes = [node for node in self._axes.nodes if isinstance(node, AxisNode)]
            names = [AXIS_NODE] if single else list(of_axes)
            self.clients = {name: AxisClient(name, node=client) for name in names}
        except BaseException:
            self._spin.close()
            raise

    @property
    def port(self) -> int:
        """The TCP port of the emulated controller; ValueError if there is none."""
        if not isinstance(self._axes, Emulation):
            raise ValueError("no controller is emulated; set the parameter emulate")
        return self._axes.port

    def node(self, name: str, **options: Any) -> Node:
        """Make a node that the executor spins."""
        return self.add(Node(name, context=self._spin.context, **options))

    def add(self, node: Node) -> Node:
        """Let the executor spin a node that was made with :attr:`context`; return it."""
        return self._spin.add(node)

    @property
    def context(self) -> Any:
        """The context of all nodes here."""
        return self._spin.context

    def close(self) -> None:
        """End all of it; twice does no harm."""
        for client in self.clients.values():
            client.close()
        self._spin.close()
        self._axes.close()
