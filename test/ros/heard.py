# SPDX-License-Identifier: Apache-2.0
"""All that an axis says, heard by somebody who does not use our client."""

from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from live import Ros
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState

from stickslip_ros.axis import Event
from stickslip_ros.axis.joints import JointReport, joints_of
from stickslip_ros.axis.resimulation import Rerun


def stamp(message: Any) -> int:
    """Return the stamp of a message, ns."""
    return int(message.header.stamp.sec) * 10**9 + int(message.header.stamp.nanosec)


def values(status: DiagnosticStatus) -> dict[str, str]:
    """Return the values of a status by key."""
    return {pair.key: pair.value for pair in status.values}


class Heard:
    """States, events and reports of an axis, as they arrive; earlier events, too."""

    def __init__(self, ros: Ros, axis: str = "/stickslip_axis", name: str = "listener") -> None:
        """Join; late, like a recorder, as the events wait for it."""
        self.ros, self.axis, self.node = ros, axis, ros.node(name)
        self.joints: list[JointState] = []
        self.truth: list[JointState] = []
        self.contact: list[JointState] = []
        self.events: list[tuple[int, dict[str, str]]] = []  # stamp of the message; values
        self.reports: list[DiagnosticStatus] = []
        latched = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        joints = f"{axis.rpartition('/')[0]}/joint_states"
        hear = self.node.create_subscription
        hear(DiagnosticArray, f"{axis}/events", self._on_events, latched)
        hear(JointState, joints, self.joints.append, 1000)
        hear(JointState, f"{axis}/truth", self.truth.append, 1000)
        hear(JointState, f"{axis}/contact", self.contact.append, 1000)
        hear(DiagnosticArray, "/diagnostics", self._on_report, 1000)
        ros.wait_until(
            lambda: self.events and self.joints and self.truth and self.contact, "events and states"
        )

    def _on_events(self, message: DiagnosticArray) -> None:
        self.events += [(stamp(message), values(status)) for status in message.status]

    def _on_report(self, message: DiagnosticArray) -> None:
        self.reports += message.status

    def event(self, name: str, outcome: str, count: int = 1) -> dict[str, str]:
        """Wait for so many events of a kind and return the values of the last of them."""

        def found() -> list[dict[str, str]]:
            wanted = (name, outcome)
            return [e for _, e in list(self.events) if (e["event"], e["outcome"]) == wanted]

        self.ros.wait_until(lambda: len(found()) >= count, f"{count} x {name} {outcome}")
        return found()[count - 1]

    def next_report(self) -> dict[str, DiagnosticStatus]:
        """Wait for diagnostics made from now on; return them by the last word of their names."""
        self.reports.clear()

        def fresh() -> dict[str, DiagnosticStatus]:
            mine = [s for s in list(self.reports) if s.hardware_id == self.axis[1:]]
            by_name = {s.name.rpartition(": ")[2]: s for s in mine}
            return by_name if set(by_name) == {"axis", "friction", "timing"} else {}

        found: dict[str, DiagnosticStatus] = self.ros.wait_until(fresh, "diagnostics")
        return found

    def compare_with_rerun(self) -> int:
        """Run the events once more without ROS; assert the same states, return how many.

        Both those that the sensor reads and the true ones. The last may be later than the events
        heard, so those after the last event stay out.
        """
        events, report, first = list(self.events), JointReport(), True
        rerun = Rerun([event for _, one in events if (event := Event.of(one))])
        both = [(stamp(one), 0, one) for one in self.truth]
        both += [(stamp(one), 1, one) for one in self.joints]
        known = [one for one in sorted(both, key=lambda one: one[:2]) if one[0] <= events[-1][0]]
        for ns, is_read, message in known:
            axis = rerun.advance((ns - events[0][0]) * 1e-9)
            joints = report.take(axis) if is_read else joints_of(axis)
            _, positions, velocities, efforts = (list(c) for c in zip(*joints, strict=True))
            assert positions == list(message.position), ns
            assert efforts == list(message.effort), ns
            if not (is_read and first):  # what it counts from was not heard
                assert velocities == list(message.velocity), ns
            first = first and not is_read
        return len(known)
