# SPDX-License-Identifier: Apache-2.0
"""Runs a node of ours for a subcommand, with the subcommand's options as its parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import Any

from stickslip_ros.cli.options import UsageError


def run_node(
    program: str, module: str, node: str, given: Mapping[str, Any], remaps: Sequence[str] = ()
) -> int:
    """Run a node class of ``stickslip_ros.ros`` until it ends; return its exit code.

    given are parameters by name, None for those that were not given; remaps have the form
    ``/old:=/new``. Raises UsageError where there is no ROS.
    """
    try:
        from rclpy.parameter import Parameter

        from stickslip_ros.ros.process import run
    except ImportError as error:
        raise UsageError(
            f"needs ROS 2: source it, or pip install 'stickslip_ros[ros]' ({error})"
        ) from None
    for remap in remaps:
        if ":=" not in remap:
            raise UsageError(f"--remap is {remap!r}; it has to look like /old:=/new")
    kind = getattr(import_module(f"stickslip_ros.ros.{module}"), node)
    overrides = [Parameter(name, value=value) for name, value in given.items() if value is not None]
    rules = [word for remap in remaps for word in ("-r", remap)]
    return run(
        program,
        [program, "--ros-args", *rules] if rules else [program],
        lambda stop_requested: kind(stop_requested, parameter_overrides=overrides),
    )
