# SPDX-License-Identifier: Apache-2.0
"""Node ``stickslip_axis``: one simulated axis, driven over topics, in real time.

The simulation follows the steady clock in blocks: each block advances it to the present time, and
so does each command, which therefore acts when it arrives. Stamps are the time of the start plus
the time simulated, so they rise even if the clock of the machine is set back.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from time import perf_counter
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.task import Future
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, Int32

from stickslip_ros.axis import Axis, CommandRefused, Pacer
from stickslip_ros.compiled import telling_when_compiling
from stickslip_ros.nodes import axis_parameters
from stickslip_ros.nodes.diagnostics import Diagnostics
from stickslip_ros.nodes.messages import StateMessages, diagnostic_array, event_status, stamp
from stickslip_ros.nodes.process import StopRequested, run
from stickslip_ros.parameters import PARAMETERS, ParameterError

NODE_NAME = "stickslip_axis"
_DEPTH = 10
_SIGNAL_PERIOD = 0.1  # s, between looks at whether a signal asks to end
_DIAGNOSTICS_PERIOD = 1.0  # s
_WARN_PERIOD = 1.0  # s, between warnings of the same kind


class AxisNode(Node):
    """Hosts one axis and runs until :attr:`finished` is done."""

    def __init__(self, stop_requested: StopRequested = lambda: False, **options: Any) -> None:
        """Read the parameters, set up the axis, start.

        stop_requested is looked at ten times a second, true ends the node; options are those of
        `rclpy.node.Node`. Raises ParameterError.
        """
        super().__init__(NODE_NAME, automatically_declare_parameters_from_overrides=True, **options)
        self.finished: Future = Future()
        values = axis_parameters.declare(self)
        self.axis = Axis(values)
        self._stop_requested = stop_requested
        self._messages = StateMessages(values["axis_name"])
        self._name = self.get_fully_qualified_name().lstrip("/")
        self._diagnostics = Diagnostics(self._name)
        with telling_when_compiling():
            self._diagnostics.statuses(self.axis, Pacer(1.0), 0.0)

        self._joints = self.create_publisher(JointState, "joint_states", _DEPTH)
        self._contact = self.create_publisher(JointState, "~/contact", _DEPTH)
        self._events = self.create_publisher(DiagnosticArray, "~/events", _DEPTH)
        self._diagnostics_out = self.create_publisher(DiagnosticArray, "/diagnostics", _DEPTH)
        axis = self.axis
        for kind, name, command in (
            # Of commands that wait together the drive is set before the steps are begun.
            (Float64, "amplitude", axis.command_amplitude),
            (Float64, "frequency", axis.command_frequency),
            (Int32, "steps", axis.command_steps),
        ):
            self.create_subscription(kind, f"~/command/{name}", self._carry_out(command), _DEPTH)
        self.add_on_set_parameters_callback(self._check_parameters)
        self.add_post_set_parameters_callback(self._set_parameters)

        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._start_stamp = self.get_clock().now().nanoseconds
        self._start = self._steady.now().nanoseconds
        self._pacer = Pacer(1.0 / values["publish_rate"])
        self.create_timer(self._pacer.period, self._block, clock=self._steady)
        self.create_timer(_DIAGNOSTICS_PERIOD, self._publish_diagnostics, clock=self._steady)
        self.create_timer(_SIGNAL_PERIOD, self._look_for_signal, clock=self._steady)
        self.get_logger().info(
            f"axis {values['axis_name']} ready: {values['model']}, "
            f"preload {values['preload']:g} N, mass {values['mass']:g} kg"
        )

    def close(self) -> None:
        """Publish what happened since the last block."""
        self._publish_events()

    # -- time

    def _now(self) -> float:
        """Time since the start, s."""
        return (self._steady.now().nanoseconds - self._start) * 1e-9

    def _stamp(self) -> Any:
        return stamp(self._start_stamp + round(self.axis.state.t * 1e9))

    def _advance(self) -> None:
        started = perf_counter()
        self.axis.advance(self._now())
        self._diagnostics.note_block(perf_counter() - started)

    def _block(self) -> None:
        missed = self._pacer.missed
        if not self._pacer.tick(self._now()):
            return
        if self._pacer.missed > missed:
            self.get_logger().warning(
                f"{self._pacer.missed} deadlines of {1e3 * self._pacer.period:g} ms missed so far; "
                "lower publish_rate or the load of the machine",
                throttle_duration_sec=_WARN_PERIOD,
            )
        self._advance()
        self._messages.fill(self.axis.state, self._stamp())
        self._joints.publish(self._messages.joints)
        self._contact.publish(self._messages.contact)
        self._publish_events()

    def _publish_events(self) -> None:
        statuses = [event_status(self._name, event) for event in self.axis.take_events()]
        if statuses:
            self._events.publish(diagnostic_array(self._stamp(), statuses))

    def _publish_diagnostics(self) -> None:
        statuses = self._diagnostics.statuses(self.axis, self._pacer, self._now())
        self._diagnostics_out.publish(diagnostic_array(self._stamp(), statuses))

    def _look_for_signal(self) -> None:
        if self._stop_requested() and not self.finished.done():
            self.finished.set_result(None)

    # -- commands

    def _carry_out(self, command: Callable[[Any], None]) -> Callable[[Any], None]:
        """Return the callback that hands the data of a message to a command of the axis."""

        def callback(message: Any) -> None:
            self._advance()
            try:
                command(message.data)
            except CommandRefused as refusal:
                self.get_logger().warning(
                    f"command refused: {refusal}", throttle_duration_sec=_WARN_PERIOD
                )
            self._publish_events()

        return callback

    def _check_parameters(self, changes: list[Parameter]) -> SetParametersResult:
        ours = {p.name: p.value for p in changes if p.name in PARAMETERS}
        try:
            self.axis.checked(ours)
        except ParameterError as error:
            self.axis.refuse("parameters", ours, str(error))
            self._publish_events()
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _set_parameters(self, changes: list[Parameter]) -> None:
        ours = {p.name: p.value for p in changes if p.name in PARAMETERS}
        if ours:
            self._advance()
            self.axis.set_parameters(ours)
            self._publish_events()


def main(args: Sequence[str] | None = None) -> int:
    """Run the node; return 0 when it was told to end, 2 on bad use."""
    return run("axis_node", args, AxisNode)


if __name__ == "__main__":
    sys.exit(main())
