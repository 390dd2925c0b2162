# SPDX-License-Identifier: Apache-2.0
"""The tests' fixtures, which the campaigns of `validation/` share, are in `shared_fixtures`."""

import importlib.util

#: The first also where the package is used as it is, without having been installed.
pytest_plugins = ("stickslip_ros.testing", "shared_fixtures")
#: What is about ROS throughout.
collect_ignore_glob = [] if importlib.util.find_spec("rclpy") else ["ros/*"]
