# SPDX-License-Identifier: Apache-2.0
"""Simulates every figure, table and claim of the paper, and compares with the printed numbers.

A new claim is a function in one of these files and a line in ``report.py``, with its text in
``claims.yaml``, the bounds of its numbers in ``checks.csv`` and its picture in ``charts.yaml``.
"""

from stickslip_ros.paper.claim import Basis, Check, Claim, Result
from stickslip_ros.paper.claim import ClaimVerdict as Verdict
from stickslip_ros.paper.report import CLAIMS, PAGE, FolderError, refuse_foreign, report
from stickslip_ros.paper.report import ClaimOutcome as Outcome

__all__ = [
    "CLAIMS",
    "PAGE",
    "Basis",
    "Check",
    "Claim",
    "FolderError",
    "Outcome",
    "Result",
    "Verdict",
    "refuse_foreign",
    "report",
]
