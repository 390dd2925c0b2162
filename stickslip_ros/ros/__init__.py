# SPDX-License-Identifier: Apache-2.0
"""The only room with ROS: nodes, the client of an axis, axes for tests."""
