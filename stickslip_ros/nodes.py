# SPDX-License-Identifier: Apache-2.0
"""The old place of the nodes: `stickslip_ros.nodes.axis_node` is `stickslip_ros.ros.axis_node`."""

import sys
import warnings

from stickslip_ros.ros import axis_node

warnings.warn("stickslip_ros.nodes is stickslip_ros.ros now", DeprecationWarning, stacklevel=2)
sys.modules[f"{__name__}.axis_node"] = axis_node
