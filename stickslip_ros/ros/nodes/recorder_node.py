# SPDX-License-Identifier: Apache-2.0
"""Node that records topics, as they come off the wire, into rosbag2 folders.

It ends on SIGINT, SIGTERM, SIGHUP or a call of ``~/stop``, always with a closed bag. With the
parameter ``wait`` it records from ``~/start`` to ``~/stop``, as often as it is asked to.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from datetime import datetime
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.qos import HistoryPolicy, QoSProfile
from std_srvs.srv import Trigger

from stickslip_ros.base.errors import UsageError
from stickslip_ros.base.files import reason_and_cure
from stickslip_ros.physics.parameters.groups import AXIS_NODE
from stickslip_ros.recordings import COMPRESSIONS, BagError, BagWriter
from stickslip_ros.ros.nodes.guarded_node import GuardedNode
from stickslip_ros.ros.nodes.messages import diagnostic_array, diagnostic_status
from stickslip_ros.ros.nodes.node_parameters import OwnParameter, full_name, read_own, run_node
from stickslip_ros.ros.nodes.recording import Choice, Recording

NODE_NAME = "stickslip_recorder"

# The answer to ~/stop is reliable: the node has to live on to repeat a lost one.
STOP_LINGER = 0.3  # s

#: Requests that come while a bag is closed wait in line; with the usual ten, all others are lost.
SERVICE_QOS = QoSProfile(history=HistoryPolicy.KEEP_ALL)

PARAMETERS = (
    OwnParameter("output", "", "folder of the new bag; empty: stickslip_<date>-<time> right here"),
    OwnParameter("topics", [""], "topics to record; none: all topics of the axes"),
    OwnParameter("regex", "", "record every topic whose full name matches, too"),
    OwnParameter("axis", "", "full name of the axis node; empty: every axis that is found"),
    OwnParameter("axes", [""], "full names, where there are several axes"),
    OwnParameter("compression", "none", f"of chunks: {', '.join(COMPRESSIONS)}"),
    OwnParameter(
        "max_size", 0.0, "MB after which a new file begins; 0: never", "MB", 0.05, 1e9, "never"
    ),
    OwnParameter(
        "max_duration", 0.0, "s after which a new file begins; 0: never", "s", 0.1, 1e9, "never"
    ),
    OwnParameter("fsync", True, "bring the bag to the disk twice a second; off: at its end"),
    OwnParameter("wait", False, "record from ~/start to ~/stop, as often as asked"),
    OwnParameter("status_period", 10.0, "s between log lines; 0: none", "s", 0.1, 1e9, "none"),
)


class RecorderNode(GuardedNode):
    """Records until :attr:`finished` is done; the bag is closed then."""

    def __init__(self, **options: Any) -> None:
        """Read the parameters, make the bag, subscribe.

        options are those of `rclpy.node.Node`. Raises UsageError for a bad parameter, BagError if
        there can be no bag.
        """
        super().__init__(NODE_NAME, **options)
        self._given = read_own(self, PARAMETERS)
        self._choice = self._chosen()
        if (compression := self._given["compression"]) not in COMPRESSIONS:
            raise UsageError(
                f"parameter compression is {compression!r}; "
                f"it has to be one of {', '.join(COMPRESSIONS)}"
            )
        self._recording: Recording | None = None
        self._bags = 0
        # rosbag2's own recorder listens to ~/split_bagfile as well; these are plain Triggers.
        for name, answer in (("start", self._start), ("stop", self._stop), ("split", self._split)):
            take = partial(self._answer, answer)
            self.create_service(Trigger, f"~/{name}", take, qos_profile=SERVICE_QOS)
        self._linger = self.create_timer(STOP_LINGER, lambda: self._end(), autostart=False)
        if self.followed:
            self.get_logger().info(
                "use_sim_time: /clock stamps the diagnostics; the times of reception in the bag "
                "stay those of the machine's clock, as a bag is in their order"
            )
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        if self._given["wait"]:
            self.get_logger().info("waiting for a call of ~/start")
        else:
            self._start()
        self.create_timer(0.1, self._poll)
        self.create_timer(0.5, self._flush)  # the most that is lost with the process
        self.create_timer(1.0, self._report)
        if self._given["status_period"]:
            self.create_timer(self._given["status_period"], self._say)

    def close(self) -> None:
        """Record the waiting messages, close the bag, log its content; closing twice does no harm.

        Raises BagError if writing fails.
        """
        if self._recording is not None:
            self._recording.close()

    # -- parameters

    def _chosen(self) -> Choice:
        given = self._given
        try:
            pattern = re.compile(given["regex"]) if given["regex"] else None
        except re.error as error:
            raise UsageError(
                f"parameter regex: {given['regex']!r} is not a regular expression: {error}"
            ) from None
        axes = [name for name in (*given["axes"], given["axis"]) if name]
        return Choice(
            frozenset(full_name(self, "topics", name) for name in given["topics"] if name),
            pattern,
            # The usual one is expected from the start, so that nothing of it is missed.
            tuple(full_name(self, "axis", name) for name in axes or [f"/{AXIS_NODE}"]),
            every=not axes,
        )

    # -- recordings

    @property
    def _under_way(self) -> Recording | None:
        recording = self._recording
        return None if recording is None or recording.bag.closed else recording

    def _start(self) -> str:
        if self._under_way:
            raise BagError(f"already recording to {self._under_way.bag.folder}; stop first")
        given = self._given
        folder = given["output"] or datetime.now().strftime("stickslip_%Y_%m_%d-%H_%M_%S")
        if given["output"] and self._bags:
            folder = f"{folder.rstrip('/')}_{self._bags + 1}"
        bag = BagWriter(
            folder,
            ros_distro=os.environ.get("ROS_DISTRO", "jazzy"),
            compression=given["compression"],
            max_bytes=round(1e6 * given["max_size"]),
            max_duration_ns=round(1e9 * given["max_duration"]),
            sync=given["fsync"],
        )
        self._recording = Recording(self, bag, self._choice)
        self._bags += 1
        return f"recording to {bag.folder}"

    def _stop(self) -> str:
        recording = self._recording
        if recording is None:
            raise BagError("nothing is being recorded; start first")
        try:
            recording.close()
        except BagError as error:
            self._end(error)
            raise
        if not self._given["wait"]:
            self._linger.reset()  # once more with every call that is answered
        return f"{recording.bag.folder}: {recording.bag.message_count} messages"

    def _split(self) -> str:
        if not self._under_way:
            raise BagError("nothing is being recorded; start first")
        bag = self._under_way.bag
        bag.split()
        return f"{bag.folder}: file {len(bag.files)} begins"

    def _answer(self, action: Callable[[], str], _: Any, response: Any) -> Any:
        """Call a function for a service, and report its success or failure."""
        try:
            response.message = action()
            response.success = True
        except BagError as error:
            response.message = str(error)
        return response

    def note_failure(self, source: str, error: Exception) -> None:
        """End if the bag cannot be written; pass over anything else as every node does."""
        if isinstance(error, MemoryError):  # messages that found no memory are missing in the bag
            error = BagError(f"cannot record {source}: {reason_and_cure(error)}")
        if isinstance(error, BagError):
            self._end(error)
        else:
            super().note_failure(source, error)

    def _end(self, error: BagError | None = None) -> None:
        if not self.finished.done():
            self.finished.set_exception(error) if error else self.finished.set_result(None)

    # -- from time to time

    def _poll(self) -> None:
        """Look for new topics and publishers."""
        if self._under_way and not self.finished.done():
            self._under_way.follow_graph()

    def _flush(self) -> None:
        if self._under_way:
            bag = self._under_way.bag
            if not bag.folder.is_dir():
                raise BagError(f"the bag {bag.folder} was removed during the recording")
            bag.flush()

    def _say(self) -> None:
        if self._under_way:
            bag = self._under_way.bag
            self.get_logger().info(
                f"{bag.message_count} messages, {self._under_way.rate:.1f}/s, "
                f"{1e-6 * bag.size:.1f} MB, lost {self._under_way.lost[0]}"
            )

    def _report(self) -> None:
        if self.followed:
            self.followed.missing()
        recording = self._under_way
        values: dict[str, Any] = {"state": "waiting"}
        level, message = DiagnosticStatus.OK, "waiting"
        if recording is not None:
            bag, (lost, before_joining) = recording.bag, recording.lost
            new = recording.count_anew()
            level = DiagnosticStatus.WARN if new else DiagnosticStatus.OK
            message = f"{new} messages lost" if new else "recording"
            values = {
                "state": "recording",
                "bag": str(bag.folder),
                "messages": bag.message_count,
                "messages per second (1/s)": recording.rate,
                "size (B)": bag.size,
                "files": len(bag.files),
                "messages lost": lost,
                "messages before joining": before_joining,
            }
            for topic in recording.topics.values():
                if topic.losses.lost:
                    values[f"lost on {topic.name}"] = topic.losses.lost
        name = self.get_fully_qualified_name().lstrip("/")
        status = diagnostic_status(name, "recording", level, message, values)
        self._diagnostics.publish(diagnostic_array(self.get_clock().now().to_msg(), [status]))


#: Runs the recorder; returns 0 when the bag is whole, 1 if writing failed, 2 on bad use
main = partial(run_node, "recorder_node", RecorderNode, "Records topics into bags.", PARAMETERS)
