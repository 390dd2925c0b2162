# SPDX-License-Identifier: Apache-2.0
"""The three statuses of an axis for /diagnostics: axis, friction, timing (REP-107)."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticStatus

from stickslip_ros.analysis import phase_now, regime_now, zero_amplitude
from stickslip_ros.analysis.zero_amplitude import LOAD_MOVES, why_no_zero_amplitude
from stickslip_ros.axis import Axis, Pacer
from stickslip_ros.nodes.messages import diagnostic_status

OK, WARN = DiagnosticStatus.OK, DiagnosticStatus.WARN


class Diagnostics:
    """Judges an axis once in a while; remembers what happened since the last time."""

    def __init__(self, node: str) -> None:
        """Name the statuses after the node."""
        self._node = node
        self._refused = 0
        self._missed = 0
        self._blocks: list[float] = []
        self._last: tuple[float, float] | None = None  # wall time, simulated time
        self._zero: tuple[float | None, str] = (None, "")
        self._zero_of: object = None

    def note_block(self, seconds: float) -> None:
        """Take the time that advancing the axis took."""
        self._blocks.append(seconds)

    def statuses(self, axis: Axis, pacer: Pacer, now: float) -> list[DiagnosticStatus]:
        """Return the statuses axis, friction and timing; now is the time since the start, s."""
        return [self._axis(axis), self._friction(axis), self._timing(axis, pacer, now)]

    def _status(self, name: str, level: bytes, message: str, **values: object) -> DiagnosticStatus:
        return diagnostic_status(f"{self._node}: {name}", level, message, values, self._node)

    def _axis(self, axis: Axis) -> DiagnosticStatus:
        status = axis.status
        refused_now, self._refused = status.refused - self._refused, status.refused
        return self._status(
            "axis",
            WARN if refused_now else OK,
            f"{refused_now} commands refused" if refused_now else status.state,
            **{
                "state": status.state,
                "steps done": status.steps_done,
                "steps left": status.steps_left,
                "amplitude (V)": status.amplitude,
                "frequency (Hz)": status.frequency,
                "limits hit": 0,
                "refused commands": status.refused,
                "last error": status.last_error,
            },
        )

    def _friction(self, axis: Axis) -> DiagnosticStatus:
        status, state, plant = axis.status, axis.state, axis.plant
        zero, why_none = self._zero_amplitude(axis)
        stroke = status.amplitude * axis.parameters["gain"]
        level, message = OK, "steps"
        if why_none == LOAD_MOVES:
            level, message = WARN, LOAD_MOVES
        elif zero is None or stroke <= zero:
            level, message = WARN, "the amplitude is not above the 0-amplitude: no steps"
        return self._status(
            "friction",
            level,
            message,
            **{
                "model": axis.parameters["model"],
                "preload (N)": axis.parameters["preload"],
                "z_ba (m)": plant.contact.z_ba,
                "z_ss (m)": plant.contact.z_ss,
                "stiffness (N/m)": plant.contact.sigma_0,
                "deflection (m)": state.z,
                "friction force (N)": state.force,
                "regime": regime_now(axis.simulation),
                "phase": phase_now(axis.simulation),
                "last step size (m)": status.last_step,
                "backstep (m)": status.backstep,
                "mean step size (m)": status.mean_step,
                "0-amplitude (m)": zero,
                "ringing frequency (Hz)": plant.ringing_frequency,
                "energy lost per cycle (J)": status.lost,
            },
        )

    def _timing(self, axis: Axis, pacer: Pacer, now: float) -> DiagnosticStatus:
        simulated = axis.state.t
        factor = float("nan")
        if self._last is not None and now > self._last[0]:
            factor = (simulated - self._last[1]) / (now - self._last[0])
        self._last = (now, simulated)
        blocks, self._blocks = self._blocks or [0.0], []
        missed_now, self._missed = pacer.missed - self._missed, pacer.missed
        worst_lag = pacer.worst_lag
        pacer.forget_worst()
        return self._status(
            "timing",
            WARN if missed_now else OK,
            f"{missed_now} deadlines missed" if missed_now else "on time",
            **{
                "real-time factor": factor,
                "missed deadlines": pacer.missed,
                "lag (s)": pacer.lag,
                "worst lag (s)": worst_lag,
                "block execution time, mean (s)": sum(blocks) / len(blocks),
                "block execution time, worst (s)": max(blocks),
            },
        )

    def _zero_amplitude(self, axis: Axis) -> tuple[float | None, str]:
        """Return the 0-amplitude, or None and why there is none.

        Determined anew only when something it hangs on has changed.
        """
        p = {**axis.parameters, "frequency": axis.status.frequency}
        key = tuple(p.values())
        if self._zero_of != key:
            zero = zero_amplitude(p)
            self._zero = (zero, why_no_zero_amplitude(p) if zero is None else "")
            self._zero_of = key
        return self._zero
