# SPDX-License-Identifier: Apache-2.0
"""Speed and error of the solver and of general ones, on the same cases in one run."""

from validation.benchmark.cases import CASES, Case
from validation.benchmark.measuring import (
    FULL,
    LIMIT,
    QUICK,
    CaseResult,
    Effort,
    load,
    measure,
    work,
)
from validation.benchmark.methods import METHODS, OURS, PEERS, MissingPeer
from validation.benchmark.results import as_json, plot, summary, table

__all__ = [
    "CASES", "FULL", "LIMIT", "METHODS", "OURS", "PEERS", "QUICK", "Case", "CaseResult", "Effort",
    "MissingPeer", "as_json", "load", "measure", "plot", "summary", "table", "work",
]  # fmt: skip
