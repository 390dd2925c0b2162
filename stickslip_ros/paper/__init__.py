# SPDX-License-Identifier: Apache-2.0
"""Every figure, table and claim of the paper that can be simulated, beside what it says.

A new claim is a function in one of these files and a line in ``report.py``, its text in
``claims.yaml``, and what its numbers are held against in ``checks.csv``.
"""

from stickslip_ros.paper.claim import Basis, Check, Claim, Result, Verdict
from stickslip_ros.paper.report import CLAIMS, PAGE, FolderError, Outcome, refuse_foreign, report

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
