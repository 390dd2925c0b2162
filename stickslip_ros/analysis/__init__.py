# SPDX-License-Identifier: Apache-2.0
"""What a run means: step size and backstep, 0-amplitude, phases, traces."""

from stickslip_ros.analysis.phases import phase_now, points, regime_now
from stickslip_ros.analysis.steps import StepRun, run_steps
from stickslip_ros.analysis.trace import Trace, save_csv, trace_steps
from stickslip_ros.analysis.zero_amplitude import zero_amplitude

__all__ = [
    "StepRun",
    "Trace",
    "phase_now",
    "points",
    "regime_now",
    "run_steps",
    "save_csv",
    "trace_steps",
    "zero_amplitude",
]
