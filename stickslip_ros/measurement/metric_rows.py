# SPDX-License-Identifier: Apache-2.0
"""The table of the metrics of a comparison; loads nothing that computes, for help texts."""

from __future__ import annotations

from typing import NamedTuple


class MetricRow(NamedTuple):
    """A quantity that a run of steps has in both motions."""

    name: str
    unit: str  #: SI
    limit: str  #: its option of `compare`, after ``--max-``; "": none
    floor: float  #: least tolerance: of a length in m, else as a part of the run's value
    meaning: str
    scaled: bool = False  #: whether the gain of the sensor counts
    missing: str = ""  #: why the value may be nan


#: All metrics. A tenth of a nanometre is ten times what the model is solved to; the period has its
#: last digits from floating-point times.
METRICS = (
    MetricRow(
        "period", "s", "", 1e-9,
        "time from slip to slip; of a run that is simulated, that of its parameters"),
    MetricRow(
        "step size", "m", "step-error", 1e-10,
        "way from slip to slip", scaled=True, missing="too few cycles"),
    MetricRow(
        "backstep", "m", "backstep-error", 1e-10,
        "fall after the slip", scaled=True, missing="too few samples after the slips"),
    MetricRow(
        "ringing frequency", "Hz", "frequency-error", 5e-3,
        "of the ringing after the slips", missing="no ringing seen"),
    MetricRow(
        "damping ratio", "", "damping-error", 2e-2,
        "of the same", missing="no ringing seen"),
)  # fmt: skip
