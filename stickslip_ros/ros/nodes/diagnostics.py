# SPDX-License-Identifier: Apache-2.0
"""Status messages of an axis: axis, friction and timing for /diagnostics (REP-107).

Its description (parameters, ranges of commands, joints, version) is published once, latched.
"""

from __future__ import annotations

import contextlib
import math
import os
import threading
from collections import Counter
from collections.abc import Sequence
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus

from stickslip_ros.axis import Axis, AxisStatus
from stickslip_ros.axis.command import LONG_WAIT, STOP_ENDS
from stickslip_ros.axis.commands import COMMANDS
from stickslip_ros.axis.joints import TRUTH, said_force
from stickslip_ros.axis.pace import overload
from stickslip_ros.base.errors import StickslipError
from stickslip_ros.physics.parameters import PARAMETERS, Parameters
from stickslip_ros.physics.parameters.groups import CONTACT_SUFFIX, PIEZO, SLIDER
from stickslip_ros.ros.nodes.messages import diagnostic_status
from stickslip_ros.ros.nodes.sim_loop import SimLoop
from stickslip_ros.simulation.operating_points import (
    LOAD_MOVES,
    why_no_zero_amplitude,
    zero_amplitude,
)
from stickslip_ros.simulation.phases import phase_now, regime_now
from stickslip_ros.version import __version__

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
LATER, _PATIENCE = "the 0-amplitude is being computed", 0.02  # s that a report waits for it

#: Keys of ``~/status``: the attribute of `AxisStatus` that each holds, and what docs/states.md says
STATUS_KEYS = {
    "state": ("state", "one of those above"),
    "moving": ("moving", "`True` while cycles or a slow move of the actuator run, else `False`"),
    "paused": ("paused", "`True` while the time of the axis stands still"),
    "target reached": ("target_reached", "`True` while the closed loop holds its target"),
    "target (m)": ("target", "where the closed loop wants to be now; `nan` in open loop"),
    "following error (m)": ("following_error", "target less position; `nan` in open loop"),
    "measured position (m)": ("position", "from the zero that was set; `nan` without a reading"),
    "zero offset (m)": ("zero_offset", "what is subtracted from the reading"),
    "velocity (m/s)": ("velocity", "mean over the last 10 ms"),
    "steps commanded": ("step_count", "cycles since the start, those backward taken off"),
    "steps done": ("steps_done", "of the present or last run, with sign"),
    "steps left": ("steps_left", "of the present run, with sign; 0 for a jog"),
    "begins (s)": (
        "begins",
        "when what waits for the running cycle begins; `nan` if nothing waits",
    ),
    "amplitude (V)": ("amplitude", "as commanded, peak to peak"),
    "frequency (Hz)": ("frequency", "as commanded; of a jog its own"),
    "scan level (V)": ("scan_level", "of the actuator, without the drive cycles"),
    "load (N)": ("load", "external force along the axis"),
    "held at": ("held_at", "`low` or `high` while that end of the travel holds the runner"),
    "limits hit": ("limits_hit", "ends of the travel and soft limits, since the start"),
    "injected faults": ("injected", "those that act, with commas"),
    "refused commands": ("refused", "since the start"),
    "last error": ("last_error", "reason of the last refusal or fault"),
    "overload": ("", "why the axis does not keep its pace"),
}


class Diagnostics:
    """Makes the diagnostics of an axis; counts events since the last ones."""

    def __init__(self, node: str) -> None:
        """Name the statuses after the node."""
        self._node = node
        self._counted = Counter[str]()
        self._zero: tuple[float | None, str] = (None, LATER)
        self._zero_of: object = None
        self._computing = threading.Thread()

    def prepare(self, axis: Axis, patience: float | None = None) -> None:
        """Compute slow results before the time begins; wait for them so long at most, s."""
        self._zero_amplitude(axis)
        self._computing.join(patience)

    def statuses(
        self,
        axis: Axis,
        sim_loop: SimLoop,
        nan_set_points: int,
        commanders: Sequence[str] = (),
        doubles: int = 0,
    ) -> list[DiagnosticStatus]:
        """Return the statuses axis, friction and timing.

        nan_set_points is a count, commanders are nodes that command the axis at once, doubles the
        number of others that publish as this axis.
        """
        status = axis.status
        news = []
        for text, count in (
            ("{} commands refused", status.refused),
            ("limits hit {} times", status.limits_hit),
            ("{} set points of NaN ignored", nan_set_points),
        ):
            if new := self._new(text, count):
                news.append(text.format(new))
        news += [f"commanded by {' and '.join(commanders)}"] if commanders else []
        news += [f"{doubles} others publish as this axis"] if doubles else []
        return [
            self.axis_status(axis, overload(axis, sim_loop.last_report), ", ".join(news)),
            self._friction(axis, status),
            self._timing(axis, sim_loop),
        ]

    def axis_status(self, axis: Axis, overload: str, news: str = "") -> DiagnosticStatus:
        """Return the status axis; overload is its reason, empty if there is none.

        news are recent events that deserve a warning.
        """
        status = axis.status
        if status.fault:
            level, message = ERROR, f"fault: {status.fault}"
        elif math.isnan(axis.arrived):
            stays = axis.parameters.node.joint_state_source != TRUTH
            away = ": joint_states stays away" if stays else ""
            level, message = WARN, f"the sensor gives no reading{away}"
        elif status.held_at:
            level, message = WARN, f"held at the {status.held_at} end of the travel"
        else:
            level, message = (WARN, overload or news) if overload or news else (OK, status.state)
            if level == OK and status.begins > axis.state.t + LONG_WAIT:
                message += f": what was commanded begins at {status.begins:.6g} s; {STOP_ENDS}"
        values = {key: getattr(status, name, overload) for key, (name, _) in STATUS_KEYS.items()}
        return diagnostic_status(self._node, "axis", level, message, values)

    def _new(self, what: str, count: int) -> int:
        """Return by how much a count has grown since the last time."""
        before, self._counted[what] = self._counted[what], count
        return count - before

    def _friction(self, axis: Axis, status: AxisStatus) -> DiagnosticStatus:
        state, plant = axis.state, axis.simulation.plant
        zero, why_none = self._zero_amplitude(axis)
        level, message = OK, "steps"
        if why_none == LOAD_MOVES:
            level, message = WARN, LOAD_MOVES
        elif why_none == LATER:
            message = why_none
        elif zero is None or status.stroke <= zero:
            level, message = WARN, "the amplitude is not above the 0-amplitude: no steps"
        values: dict[str, object] = {
            "model": axis.parameters.friction.model,
            "preload (N)": axis.parameters.friction.preload,
            "z_ba (m)": plant.contact.z_ba,
            "z_ss (m)": plant.contact.z_ss,
            "stiffness (N/m)": plant.contact.sigma_0,
            "deflection (m)": state.z,
            "friction force (N)": said_force(state.force),
            "regime": regime_now(axis.simulation),
            "phase": phase_now(axis.simulation),
            "last step size (m)": status.last_step,
            "backstep (m)": status.backstep,
            "mean step size (m)": status.mean_step,
            "0-amplitude (m)": zero,
            "ringing frequency (Hz)": plant.ringing_frequency,
            "energy lost per cycle (J)": status.lost,
        }
        return diagnostic_status(self._node, "friction", level, message, values)

    def _timing(self, axis: Axis, sim_loop: SimLoop) -> DiagnosticStatus:
        pacer, blocks, report = sim_loop.pacer, sim_loop.blocks, sim_loop.last_report
        missed_now = self._new("deadlines", pacer.missed)
        message = f"{missed_now} deadlines missed" if missed_now else "on time"
        values: dict[str, object] = {
            "real-time factor": report.factor,
            "time dropped (s)": 1e-9 * sim_loop.pace.dropped,
            "missed deadlines": pacer.missed,
            "lag (s)": pacer.lag,
            "worst lag (s)": pacer.worst_lag,
            "block execution time, mean (s)": sum(blocks) / max(len(blocks), 1),
            "block execution time, worst (s)": max(blocks, default=0.0),
            "real-time priority": sim_loop.priority,
        }
        late = WARN if missed_now or report.overload else OK
        return diagnostic_status(
            self._node, "timing", late, overload(axis, report) or message, values
        )

    def _zero_amplitude(self, axis: Axis) -> tuple[float | None, str]:
        """Return the 0-amplitude, or None and the reason.

        It is computed anew only when a parameter that it depends on has changed, and in a thread:
        where ringing lasts it takes a minute, in which nobody would be heard.
        """
        p = axis.operating_point.replace(amplitude=PARAMETERS["amplitude"].low)  # plays no part
        if self._zero_of != p and not self._computing.is_alive():
            self._zero, self._zero_of = (None, LATER), p
            self._computing = threading.Thread(target=self._compute_zero, args=(p,), daemon=True)
            self._computing.start()
            self._computing.join(_PATIENCE)
        return self._zero if self._zero_of == p else (None, LATER)

    def _compute_zero(self, p: Parameters) -> None:
        with contextlib.suppress(OSError, AttributeError):  # without the priority of the axis
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        try:
            zero = zero_amplitude(p)
            self._zero = (zero, why_no_zero_amplitude(p) if zero is None else "")
        except StickslipError as error:
            self._zero = (None, str(error))


def description(node: str, axis: Axis) -> list[DiagnosticStatus]:
    """Return the statuses ``<node>: description``, ``: parameter <name>``, ``: command <name>``."""
    p = axis.parameters
    flat, name = p.flat(), p.node.axis_name
    joints = [f"{name}{joint}" for joint in (SLIDER, PIEZO, CONTACT_SUFFIX)]
    about = {"version": __version__, "axis_name": name, "joints": joints}
    found = [diagnostic_status(node, "description", OK, "simulated stick-slip axis", about)]
    for row in PARAMETERS.values():
        values: dict[str, Any] = {"value": flat[row.name]}
        if row.kind not in (str, bool):
            values |= {"unit": row.unit, **_finite(low=row.low, high=row.high)}
        values["mutable"] = row.mutable
        text = f"parameter {row.name}"
        found.append(diagnostic_status(node, text, OK, row.description, values))
    for command in COMMANDS.values():
        if command.limits:
            low, high = command.limits(axis)
            limits = {"unit": command.unit, **_finite(low=low, high=high)}
            text = f"command {command.name}"
            found.append(diagnostic_status(node, text, OK, command.meaning, limits))
    return found


def _finite(**bounds: float) -> dict[str, float]:
    """Return finite bounds: an infinite one has no place in a text that people read as a number."""
    return {name: bound for name, bound in bounds.items() if not math.isinf(bound)}
