# SPDX-License-Identifier: Apache-2.0
"""What a record says: read, its steps found, compared with a run; identification and twin below.

Each name is loaded when it is used.
"""

from typing import TYPE_CHECKING

from stickslip_ros.base.lazy_names import lazy_names

_PLACES = {
    "comparison": "Comparison",
    "measurements": "analyse compare find_runs identify_actuator read_measurement",
    "metric": "ComparisonMetric",
    "motion_pair": "Alignment ComparisonError Fits",
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
    from stickslip_ros.measurement.metric import ComparisonMetric
    from stickslip_ros.measurement.motion_pair import Alignment, ComparisonError, Fits
else:
    __getattr__ = lazy_names(__name__, _PLACES)

__all__ = [
    "Alignment",
    "Comparison",
    "ComparisonError",
    "ComparisonMetric",
    "Fits",
    "analyse",
    "compare",
    "find_runs",
    "identify_actuator",
    "read_measurement",
]
