# SPDX-License-Identifier: Apache-2.0
"""The ROS nodes: with `client`, the only room that imports rclpy and message packages."""
