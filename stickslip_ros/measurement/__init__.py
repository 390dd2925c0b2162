# SPDX-License-Identifier: Apache-2.0
"""What a record says: read, its steps found, compared with a run; identification and twin below.

Each name is loaded when it is used.
"""

from typing import TYPE_CHECKING

from stickslip_ros.base.lazy_names import lazy_names

_PLACES = {
    "comparison": "Comparison",
    "measurements": "analyse compare find_runs identify_actuator read_measurement",
    "metrics": "ComparisonMetric",
    "motion_pair": "Alignment ComparisonError Fits",
    "verdict": "LIMITS Judgement judge",
}

if TYPE_CHECKING:
    from stickslip_ros.measurement.comparison import Comparison
    from stickslip_ros.measurement.measurements import (
        analyse,
        compare,
        find_runs,
        identify_actuator,
        read_measurement,
    )
    from stickslip_ros.measurement.metrics import ComparisonMetric
    from stickslip_ros.measurement.motion_pair import Alignment, ComparisonError, Fits
    from stickslip_ros.measurement.verdict import LIMITS, Judgement, judge
else:
    __getattr__ = lazy_names(__name__, _PLACES)

__all__ = [
    "LIMITS",
    "Alignment",
    "Comparison",
    "ComparisonError",
    "ComparisonMetric",
    "Fits",
    "Judgement",
    "analyse",
    "compare",
    "find_runs",
    "identify_actuator",
    "judge",
    "read_measurement",
]
