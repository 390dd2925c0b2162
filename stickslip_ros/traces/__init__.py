# SPDX-License-Identifier: Apache-2.0
"""Analysis of measured runs: step size and backstep, 0-amplitude, ringing."""

from stickslip_ros.traces.analysis import analyse_steps
from stickslip_ros.traces.cycles import TraceError
from stickslip_ros.traces.runs import Balance, Run

__all__ = ["Balance", "Run", "TraceError", "analyse_steps"]
