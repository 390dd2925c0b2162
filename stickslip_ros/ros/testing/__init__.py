# SPDX-License-Identifier: Apache-2.0
"""Axes for tests: several with ROS in this process, one without ROS."""
