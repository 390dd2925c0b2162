# SPDX-License-Identifier: Apache-2.0
"""The table of the metrics of a comparison; loads nothing that computes, for help texts."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from stickslip_ros.traces.steps import MeasuredValue


class MetricRow(NamedTuple):
    """A quantity that a run of steps has in both motions."""

    name: str
    unit: str  #: SI
    limit: str  #: its option of `compare`, after ``--max-``; "": none
    estimate: Callable[[Any], MeasuredValue | str]  #: of `ComparedSteps`, or why there is none
    floor: Callable[[float], float]  #: least tolerance, from the run's value
    scaled: bool = False  #: whether the gain of the sensor counts
    missing: str = ""  #: why the value may be nan


#: All metrics. A tenth of a nanometre is ten times what the model is solved to; the period has its
#: last digits from floating-point times.
METRICS = (
    MetricRow("period", "s", "", lambda of: of.period, lambda run: 1e-9 * run),
    MetricRow(
        "step size", "m", "step-error", lambda of: of.steps.mean_step, lambda run: 1e-10,
        scaled=True, missing="too few cycles"),
    MetricRow(
        "backstep", "m", "backstep-error", lambda of: of.backstep, lambda run: 1e-10,
        scaled=True, missing="too few samples after the slips"),
    MetricRow(
        "ringing frequency", "Hz", "frequency-error", lambda of: of.ringing_frequency,
        lambda run: 5e-3 * abs(run), missing="no ringing seen"),
    MetricRow(
        "damping ratio", "", "damping-error", lambda of: of.damping_ratio,
        lambda run: 2e-2 * abs(run), missing="no ringing seen"),
    MetricRow(
        "0-amplitude", "m", "zero-amplitude-error", lambda of: of.zero_amplitude,
        lambda run: 1e-10),
)  # fmt: skip
