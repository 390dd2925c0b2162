# SPDX-License-Identifier: Apache-2.0
"""Comparison of a run with a measurement: alignment, metrics, verdict, report page, picture."""

from stickslip_ros.measurement.alignment import Alignment, ComparisonError, Fits
from stickslip_ros.measurement.comparison import Comparison, compare
from stickslip_ros.measurement.metrics import Metric
from stickslip_ros.measurement.verdict import LIMITS, Judgement, judge

__all__ = [
    "LIMITS",
    "Alignment",
    "Comparison",
    "ComparisonError",
    "Fits",
    "Judgement",
    "Metric",
    "compare",
    "judge",
]
