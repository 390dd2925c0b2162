# SPDX-License-Identifier: Apache-2.0
"""What a run means: step size and backstep, 0-amplitude, phases, traces."""

from stickslip_ros.analysis.actuator_identification import (
    IdentifiedActuator,
    identify_hysteresis,
)
from stickslip_ros.analysis.cycles import TraceError
from stickslip_ros.analysis.derivations import z_ba_from_zero_amplitude
from stickslip_ros.analysis.phases import phase_now, points, regime_now
from stickslip_ros.analysis.slip_shaping import ShapedSlip, shape_slip, shaping_map
from stickslip_ros.analysis.step_analysis import Balance, StepAnalysis, analyse_steps
from stickslip_ros.analysis.step_elongation import ElongatedStep, elongate_step
from stickslip_ros.analysis.steps import StepRun, run_steps
from stickslip_ros.analysis.trace import Trace, read_csv, save_csv, trace_steps
from stickslip_ros.analysis.zero_amplitude import (
    ZeroAmplitudes,
    zero_amplitude,
    zero_amplitude_from_steps,
)

__all__ = [
    "Balance",
    "ElongatedStep",
    "IdentifiedActuator",
    "ShapedSlip",
    "StepAnalysis",
    "StepRun",
    "Trace",
    "TraceError",
    "ZeroAmplitudes",
    "analyse_steps",
    "elongate_step",
    "identify_hysteresis",
    "phase_now",
    "points",
    "read_csv",
    "regime_now",
    "run_steps",
    "save_csv",
    "shape_slip",
    "shaping_map",
    "trace_steps",
    "z_ba_from_zero_amplitude",
    "zero_amplitude",
    "zero_amplitude_from_steps",
]
