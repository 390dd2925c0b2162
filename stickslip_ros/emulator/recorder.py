# SPDX-License-Identifier: Apache-2.0
"""Records what programs did to emulated axes: what they said, the events and states of the axes.

The bag is that of the axes' nodes, written without ROS, so everything that reads bags reads it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from stickslip_ros.axis import Axis
from stickslip_ros.axis.events import event_texts
from stickslip_ros.axis.joints import JointReport, Joints, joints_of
from stickslip_ros.recordings import (
    STATUS_TYPE,
    BagWriter,
    OfferedQos,
    TopicDescription,
    encoder_for,
    schema_text,
)

_SAMPLE_NS, _FLUSH_NS = 10_000_000, 500_000_000
_JOINT_STATE = "sensor_msgs/msg/JointState"
_DEFINITIONS = {
    STATUS_TYPE: "std_msgs/Header header\nDiagnosticStatus[] status",
    "diagnostic_msgs/msg/DiagnosticStatus": "byte level\nstring name\nstring message\n"
    "string hardware_id\nKeyValue[] values",
    "diagnostic_msgs/msg/KeyValue": "string key\nstring value",
    _JOINT_STATE: "std_msgs/Header header\nstring[] name\nfloat64[] position\n"
    "float64[] velocity\nfloat64[] effort",
    "std_msgs/msg/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "builtin_interfaces/msg/Time": "int32 sec\nuint32 nanosec",
}
#: Events come to those who join late too, as those of a node.
_KEPT = OfferedQos(durability="transient_local", history="keep_last", depth=1000)


class Recorder:
    """A bag of axes that stand at time 0; also a context manager that closes it.

    The topics are ``/<axis>/events``, ``/<axis>/truth`` and ``/joint_states`` as of a node, and
    ``/<controller>/commands`` with a status for each line: client, line and answer.
    """

    def __init__(
        self,
        folder: Path | str,
        controller: str,
        axes: Sequence[Axis],
        clock_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        """Make the bag; clock_ns: time (ns) since the Unix epoch. Raises BagError."""
        self._controller = controller
        self._axes = {axis.parameters.node.axis_name: (axis, JointReport()) for axis in axes}
        self._lines: list[tuple[int, tuple[int, str, str]]] = []
        self._sampled, self._flushed = -_SAMPLE_NS, 0  # ns of simulation
        self._encoders: dict[str, Callable[[Any], bytes]] = {}
        self._numbers: dict[tuple[str, str], int] = {}
        self._bag = BagWriter(folder, custom_data={"emulated": controller})
        self._start_ns = clock_ns()

    def __enter__(self) -> Recorder:
        """Return itself."""
        return self

    def __exit__(self, *error: object) -> None:
        """Close it."""
        self.close()

    def close(self) -> None:
        """Record what is left and close the bag; twice does no harm. Raises BagError."""
        try:
            if not self._bag.closed:
                self.take()
        finally:
            self._bag.close()

    def hear(self, client: int, line: str, answer: str) -> None:
        """Note what a client said and was answered, to be written with the next `take`."""
        self._lines.append((self._now(), (client, line, answer)))

    def take(self) -> None:
        """Write what has happened since the last call. Raises BagError: the disk is full, say."""
        now, latest = self._now(), -1
        for ns, (client, line, answer) in self._lines:
            values = {"client": str(client), "line": line, "answer": answer}
            who = f"{self._controller}: client {client}"
            self._write_status(f"/{self._controller}/commands", ns, 0, who, line, values)
        self._lines.clear()
        for name, (axis, _) in self._axes.items():
            for event in axis.take_events():
                told = round(event.time * 1e9)
                text, values = f"{event.name} {event.outcome}", event_texts(event)
                topic, who = f"/{name}/events", f"{name}: event"
                self._write_status(topic, told, event.level, who, text, values)
                latest = max(latest, told)
        # A state at the time of a command would be taken for the one before it.
        if now >= self._sampled + _SAMPLE_NS and latest < now:
            self._sampled = now
            for name, (axis, report) in self._axes.items():
                self._write_joints("/joint_states", now, name, report.take(axis))
                self._write_joints(f"/{name}/truth", now, name, joints_of(axis))
        if now >= self._flushed + _FLUSH_NS:
            self._flushed = now
            self._bag.flush()

    # -- inside

    def _now(self) -> int:
        """Return the time of the simulation, ns: that of the axis that is furthest."""
        return max(round(axis.state.t * 1e9) for axis, _ in self._axes.values())

    def _write_status(
        self, topic: str, ns: int, level: int, name: str, text: str, values: dict[str, str]
    ) -> None:
        status = SimpleNamespace(
            level=level,
            name=name,
            message=text,
            hardware_id=name.partition(":")[0],
            values=[SimpleNamespace(key=key, value=value) for key, value in values.items()],
        )
        self._write(topic, STATUS_TYPE, ns, name, status=[status])

    def _write_joints(self, topic: str, ns: int, axis: str, joints: Joints) -> None:
        if not joints:
            return  # the sensor gives no reading
        ends, x, v, force = zip(*joints, strict=True)
        names = [f"{axis}{end}" for end in ends]
        fields = {"name": names, "position": x, "velocity": v, "effort": force}
        self._write(topic, _JOINT_STATE, ns, axis, **fields)

    def _write(self, topic: str, kind: str, ns: int, source: str, **fields: Any) -> None:
        if topic not in self._encoders:
            qos = _KEPT if topic.endswith("/events") else OfferedQos(depth=10)
            schema = schema_text(kind, _DEFINITIONS.__getitem__)
            description = TopicDescription(topic, kind, schema, offered_qos=(qos,))
            self._bag.add_topic(description)
            self._encoders[topic] = encoder_for(description)
        number = self._numbers[topic, source] = self._numbers.get((topic, source), 0) + 1
        ns += self._start_ns
        stamp = SimpleNamespace(sec=ns // 10**9, nanosec=ns % 10**9)
        message = SimpleNamespace(header=SimpleNamespace(stamp=stamp, frame_id=""), **fields)
        data = self._encoders[topic](message)
        self._bag.write(topic, data, log_ns=ns, publish_ns=ns, sequence=number)
