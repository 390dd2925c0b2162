# SPDX-License-Identifier: Apache-2.0
"""How the figures look: colours, panels, maps."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

NANO = 1e9
CEIM, LUGRE, EPM, EPM_CALC, BLACK, GREY, RED = (
    "#1f4e9c", "#c46a1b", "#2f7d4f", "#8a4fa3", "#222222", "#8c8c8c", "#d3321d",
)  # fmt: skip
#: For curves that belong to values in order, from small to large.
ORDERED = ("#9ecae1", "#4292c6", "#1f4e9c", "#0b2a5b")
#: All by the names that charts.yaml has for them.
PALETTE = {
    "ceim": CEIM, "lugre": LUGRE, "epm": EPM, "epm_calc": EPM_CALC, "black": BLACK, "grey": GREY,
    "red": RED, **{f"blue_{k}": colour for k, colour in enumerate(ORDERED, 1)},
}  # fmt: skip


def panel(
    figure: Figure, x: str, y: str, title: str = "", at: tuple[int, int, int] = (1, 1, 1)
) -> Axes:
    """Return axes with labels (units included), a grid and a title."""
    axes = figure.add_subplot(*at)
    axes.set(xlabel=x, ylabel=y)
    if title:
        axes.set_title(title, fontsize=10)
    axes.grid(alpha=0.3)
    return axes


def legend(axes: Axes, place: Any = "best", title: str | None = None) -> None:
    """Add a legend that does not hide data."""
    axes.legend(loc=place, fontsize=8.5, framealpha=0.9, title=title)


def color_map(
    axes: Axes,
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    values: NDArray[np.float64],
    label: str,
    **options: Any,
) -> Any:
    """Draw values (len(y), len(x)) as a map and return its scale; nan stays grey."""
    axes.grid(False)
    axes.set_facecolor("#d9d9d9")
    shown = np.ma.masked_invalid(values)
    mesh = axes.pcolormesh(x, y, shown, shading="nearest", rasterized=True, **options)
    figure: Any = axes.figure
    bar = figure.colorbar(mesh, ax=axes)
    bar.set_label(label)
    return bar


def signed_map(
    axes: Axes,
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    values: NDArray[np.float64],
    limit: float,
) -> None:
    """Draw step sizes in nm, (len(y), len(x)): blue above zero, red below, white at zero."""
    label = "step size (nm)\nred: backwards"
    color_map(axes, x, y, values, label, cmap="RdBu", vmin=-limit, vmax=limit)
