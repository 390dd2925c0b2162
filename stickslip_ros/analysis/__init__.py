# SPDX-License-Identifier: Apache-2.0
"""What a run means: step size and backstep, 0-amplitude, phases, traces."""

from stickslip_ros.analysis.actuator_identification import (
    IdentifiedActuator,
    identify_hysteresis,
)
from stickslip_ros.analysis.phases import phase_now, points, regime_now
from stickslip_ros.analysis.slip_shaping import ShapedSlip, shape_slip, shaping_map
from stickslip_ros.analysis.step_elongation import ElongatedStep, elongate_step
from stickslip_ros.analysis.steps import StepRun, run_steps
from stickslip_ros.analysis.trace import Trace, save_csv, trace_steps
from stickslip_ros.analysis.zero_amplitude import zero_amplitude

__all__ = [
    "ElongatedStep",
    "IdentifiedActuator",
    "ShapedSlip",
    "StepRun",
    "Trace",
    "elongate_step",
    "identify_hysteresis",
    "phase_now",
    "points",
    "regime_now",
    "run_steps",
    "save_csv",
    "shape_slip",
    "shaping_map",
    "trace_steps",
    "zero_amplitude",
]
