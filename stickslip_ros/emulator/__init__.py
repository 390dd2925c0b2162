# SPDX-License-Identifier: Apache-2.0
"""Simulated axes behind the protocols of real controllers, over TCP. Knows no ROS."""

from stickslip_ros.emulator.controllers import CONTROLLERS, Controller, controller_of
from stickslip_ros.emulator.own_axes import OwnAxes
from stickslip_ros.emulator.server import Server
from stickslip_ros.emulator.server_thread import ServerThread

__all__ = ["CONTROLLERS", "Controller", "OwnAxes", "Server", "ServerThread", "controller_of"]
