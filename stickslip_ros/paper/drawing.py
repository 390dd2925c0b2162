# SPDX-License-Identifier: Apache-2.0
"""How the figures look: colours, grids, labels."""

from __future__ import annotations

from typing import Any

import matplotlib
import numpy as np
from numpy.typing import NDArray

matplotlib.use("Agg")
from matplotlib.axes import Axes
from matplotlib.figure import Figure

CEIM, LUGRE, EPM, EPM2, BLACK, GREY = (
    "#1f4e9c", "#c46a1b", "#2f7d4f", "#8a4fa3", "#222222", "#8c8c8c",
)  # fmt: skip
#: For curves that belong to values in order, from small to large.
ORDERED = ("#9ecae1", "#4292c6", "#1f4e9c", "#0b2a5b")


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


def legend(axes: Axes, place: Any = "best") -> None:
    """Add a legend that does not hide data."""
    axes.legend(loc=place, fontsize=8.5, framealpha=0.9)


def signed_map(
    axes: Axes,
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    values: NDArray[np.float64],
    label: str,
    limit: float,
) -> None:
    """Draw values (len(y), len(x)) as a map: blue above zero, red below, white at zero."""
    axes.grid(False)
    mesh = axes.pcolormesh(
        x, y, values, shading="nearest", cmap="RdBu", vmin=-limit, vmax=limit, rasterized=True
    )
    bar: Any = axes.figure.colorbar(mesh, ax=axes)
    bar.set_label(label)
