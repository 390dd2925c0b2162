# SPDX-License-Identifier: Apache-2.0
"""Analysis of runs: step size and backstep, 0-amplitude, phases, traces."""

from stickslip_ros.traces.analysis import analyse_steps
from stickslip_ros.traces.cycles import TraceError
from stickslip_ros.traces.runs import Balance, Run
from stickslip_ros.traces.steps import StepRun, run_steps
from stickslip_ros.traces.trace import (
    Trace,
    phase_now,
    points,
    read_csv,
    regime_now,
    save_csv,
    trace_at_rate,
    trace_steps,
)

__all__ = [
    "Balance",
    "Run",
    "StepRun",
    "Trace",
    "TraceError",
    "analyse_steps",
    "phase_now",
    "points",
    "read_csv",
    "regime_now",
    "run_steps",
    "save_csv",
    "trace_at_rate",
    "trace_steps",
]
