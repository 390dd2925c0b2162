# SPDX-License-Identifier: Apache-2.0
"""Simulated axes behind the protocols of real controllers, over TCP. Knows no ROS."""

from stickslip_ros.emulator.controllers import CONTROLLERS, Controller, controller_of
from stickslip_ros.emulator.hosting import OwnAxes, ServerThread
from stickslip_ros.emulator.server import Server

__all__ = ["CONTROLLERS", "Controller", "OwnAxes", "Server", "ServerThread", "controller_of"]
