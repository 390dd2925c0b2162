# SPDX-License-Identifier: Apache-2.0
"""Axes for tests: several with ROS in one process or in processes of their own, one without ROS."""
