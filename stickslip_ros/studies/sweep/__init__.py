# SPDX-License-Identifier: Apache-2.0
"""Sweeps: metrics over one or two varied parameters, on any executor, kept as CSV."""

from stickslip_ros.studies.sweep.executors import cluster, threads
from stickslip_ros.studies.sweep.found import Found
from stickslip_ros.studies.sweep.grid import Axis, SweepError
from stickslip_ros.studies.sweep.metrics import METRICS, Metric
from stickslip_ros.studies.sweep.sweep import Sweep, results
from stickslip_ros.studies.sweep.table import SweepTable, write_header, write_rows

__all__ = [
    "METRICS",
    "Axis",
    "Found",
    "Metric",
    "Sweep",
    "SweepError",
    "SweepTable",
    "cluster",
    "results",
    "threads",
    "write_header",
    "write_rows",
]
