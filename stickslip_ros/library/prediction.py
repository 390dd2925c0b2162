# SPDX-License-Identifier: Apache-2.0
"""The step of an axis, or the amplitude for a wanted step, in closed form."""

from __future__ import annotations

from typing import Any

from stickslip_ros.library.inputs import ParameterSource, full_set
from stickslip_ros.studies import prediction
from stickslip_ros.studies.prediction import Prediction


def predict(
    parameters: ParameterSource = None, /, *, step: float | None = None, **values: Any
) -> Prediction:
    """Return the step of an axis in closed form: stroke less a0, without a simulation.

    With step (m), return the amplitude that makes it. Parameters are as in `simulate`. The form
    holds at low frequency and steep slip (docs/prediction.md); its ``error`` is stated. Raises
    PredictionError where it does not hold, and ParameterError.

    >>> import stickslip_ros as ss
    >>> found = ss.predict(preload=0.4)
    >>> print(f"{1e9 * found.stroke:.0f} nm - {1e9 * found.zero_offset:.1f} nm")
    160 nm - 26.1 nm
    >>> print(f"{ss.predict(preload=0.4, step=100e-9).amplitude:.1f} V")
    236.2 V
    """
    p = full_set(parameters, values)
    return prediction.predict(p) if step is None else prediction.amplitude_for(p, step)
