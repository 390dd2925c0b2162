# SPDX-License-Identifier: Apache-2.0
"""The page of an identification: the content of the template ``identify.html``."""

from __future__ import annotations

from stickslip_ros.identification.fit import Fit
from stickslip_ros.pages.fitted_figures import fit_figures
from stickslip_ros.pages.texts import fit_sources
from stickslip_ros.parameters import parameter
from stickslip_ros.reporting.page import ResultPage


def fit_page(found: Fit) -> ResultPage:
    """Return the page of a fit."""
    known = {
        name: f"{value:g} {parameter(name).unit}".strip()
        for name, value in found.base.flat().items()
        if isinstance(value, float)
        and name not in found.parameters
        and not (value == 0.0 and parameter(name).optional)
    }
    parts = {"found": found, "sources": fit_sources(found), "known": known}
    return ResultPage("identify.html", fit_figures(found), parts)
