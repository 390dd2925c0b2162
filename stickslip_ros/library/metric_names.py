# SPDX-License-Identifier: Apache-2.0
"""The names of the metrics of sweeps, for help texts and completion, which load nothing heavy."""

from __future__ import annotations

from collections.abc import Mapping

#: The module of this room that has each metric, as a `SweepMetric` of that name.
METRIC_NAMES: Mapping[str, str] = {
    "step_size": "sweep_metrics",
    "backstep": "sweep_metrics",
    "mean_speed": "sweep_metrics",
    "generated_force": "sweep_metrics",
    "zero_amplitude": "sweep_metrics",
    "zero_amplitude_intersection": "sweep_metrics",
    "blocking_preload": "sweep_metrics",
}
