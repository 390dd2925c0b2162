# SPDX-License-Identifier: Apache-2.0
"""Simulator of piezo stick-slip micro-drives with an elastoplastic contact, for ROS 2."""

__version__ = "0.2.0"
