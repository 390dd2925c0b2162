# SPDX-License-Identifier: Apache-2.0
"""The parameters of the contact from measurements, with 95 % intervals from profiles."""

from stickslip_ros.measurement.identification.curve import Curve, read_curve
from stickslip_ros.measurement.identification.experiment import Experiment, IdentificationError
from stickslip_ros.measurement.identification.fit import Estimate, Fit, FittedRun
from stickslip_ros.measurement.identification.free import Prior
from stickslip_ros.measurement.identification.identify import identify

__all__ = [
    "Curve",
    "Estimate",
    "Experiment",
    "Fit",
    "FittedRun",
    "IdentificationError",
    "Prior",
    "identify",
    "read_curve",
]
