# SPDX-License-Identifier: Apache-2.0
"""Every figure, table and finding of the paper that can be simulated, beside what it says.

A new item is a file beside these and a line in ``registry.ITEMS``.
"""

from stickslip_ros.paper.item import Check, Item, Kind, Result, Verdict, verdict_of
from stickslip_ros.paper.page import Entry
from stickslip_ros.paper.registry import ITEMS
from stickslip_ros.paper.write import PAGE, FolderError, refuse_if_not_ours, report

__all__ = [
    "ITEMS",
    "PAGE",
    "Check",
    "Entry",
    "FolderError",
    "Item",
    "Kind",
    "Result",
    "Verdict",
    "refuse_if_not_ours",
    "report",
    "verdict_of",
]
