# SPDX-License-Identifier: Apache-2.0
"""The page of an identification: the content of the template ``identify.html``."""

from __future__ import annotations

from pathlib import Path

from stickslip_ros.files import write_text
from stickslip_ros.identification.fit import Fit
from stickslip_ros.pages.fitted_figures import figures
from stickslip_ros.pages.texts import fit_sources
from stickslip_ros.parameters import parameter
from stickslip_ros.reporting.page import page, plot_parts, versions


def write_page(path: Path, found: Fit, command: str) -> None:
    """Write the page, all of it or nothing; WriteError, or PageError without plotly."""
    write_text(path, page_of(found, command))


def page_of(found: Fit, command: str) -> str:
    """Return the page as HTML; command made it. Raises PageError if plotly is not installed."""
    drawn = figures(found)
    return page(
        "identify.html",
        found=found,
        sources=fit_sources(found),
        plots=drawn,
        known={
            name: f"{value:g} {parameter(name).unit}".strip()
            for name, value in found.base.flat().items()
            if isinstance(value, float)
            and name not in found.parameters
            and not (value == 0.0 and parameter(name).optional)
        },
        versions=versions(),
        command=command,
        **plot_parts({plot.name: plot.figure for plot in drawn}),
    )
