# SPDX-License-Identifier: Apache-2.0
"""Draws a square with two axes of a nanorobot, the tip lowered by the third, in closed loop.

An example of a program that commands several axes: `ros2 run stickslip_ros square --size 2.0e-6`,
beside `axis_node` with the parameter `axes:=[x, 'y', z]`.
"""

from __future__ import annotations

import argparse
import contextlib
import math
import sys
from collections.abc import Sequence

from rclpy.node import Node
from rclpy.utilities import remove_ros_args

from stickslip_ros.client import AxisClient, AxisFault, SpinThread

Point = tuple[float, float]
_MOVE = 0.5  # s for each side, and to lower or lift the tip


def draw_square(x: AxisClient, y: AxisClient, z: AxisClient, size: float) -> list[Point]:
    """Draw a square of that size (m) from 0 on; return where x and y were at the corners (m).

    The tip is a quarter of the size lower while it draws. All three take each move together, or
    none does, and they end together.
    """

    def go(*to: float) -> Point:
        x.follow_with([y, z], [(_MOVE, to)])
        at = [axis.wait().position for axis in (x, y, z)]
        return at[0], at[1]

    go(0.0, 0.0, -size / 4)
    corners = ((0.0, 0.0), (size, 0.0), (size, size), (0.0, size), (0.0, 0.0))
    reached = [go(*corner, -size / 4) for corner in corners]
    go(0.0, 0.0, 0.0)
    return reached


def main(args: Sequence[str] | None = None) -> int:
    """Run the example; return 0, 1 if an axis did not do its part, 2 on bad use."""
    parser = argparse.ArgumentParser(prog="square", description="Draw a square with axes x, y, z.")
    parser.add_argument("--size", type=float, default=2e-6, metavar="M", help="(default: 2e-6 m)")
    parser.add_argument("--namespace", default="", help="of the axes (default: none)")
    options = parser.parse_args(remove_ros_args(sys.argv if args is None else list(args))[1:])
    if not 0.0 < options.size < math.inf:
        parser.error(f"--size is {options.size:g} m; it has to be a positive number")
    prefix = options.namespace.strip("/")
    try:
        with contextlib.ExitStack() as stack:
            spin = SpinThread("square")
            stack.callback(spin.close)
            node = spin.add(Node("square", namespace=prefix, context=spin.context))
            x, y, z = (
                stack.enter_context(AxisClient(f"{prefix}/{name}", node=node, timeout=60.0))
                for name in "xyz"
            )
            corners = draw_square(x, y, z, options.size)
    except (ValueError, AxisFault, TimeoutError) as error:
        print(f"square: {error}", file=sys.stderr)
        return 1
    for at in corners:
        print(f"x {1e9 * at[0]:9.2f} nm   y {1e9 * at[1]:9.2f} nm")
    return 0


if __name__ == "__main__":
    sys.exit(main())
