# SPDX-License-Identifier: Apache-2.0
"""How the figures look: colours, panels, lines, maps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

NANO = 1e9
CEIM, LUGRE, EPM, EPM_CALC, BLACK, GREY = (
    "#1f4e9c", "#c46a1b", "#2f7d4f", "#8a4fa3", "#222222", "#8c8c8c",
)  # fmt: skip
#: For curves that belong to values in order, from small to large.
ORDERED = ("#9ecae1", "#4292c6", "#1f4e9c", "#0b2a5b")
#: A line of a plot: its column in the table ("": none) with y, its label, its colour, and a format
#: of Matplotlib such as "--".
Line = tuple[str, NDArray[np.float64], str, str, str]


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


def lines(
    x: tuple[str, NDArray[np.float64]],
    curves: Sequence[Line],
    labels: tuple[str, str],
    place: Any = "best",
    scales: tuple[float, float] = (1.0, NANO),
    zero: bool = False,
    **axes_options: Any,
) -> dict[str, Any]:
    """Return the table of curves over x and the function that draws them, for a `Result`.

    labels are those of the axes, and scales what one of x and of y is there; zero adds a line.
    axes_options go to ``Axes.set``, such as xlim and yscale.
    """

    def draw(figure: Figure) -> None:
        axes = panel(figure, *labels)
        for _, y, label, colour, form in curves:
            drawn = scales[0] * x[1], scales[1] * y
            axes.plot(*drawn, form, color=colour, label=label, markersize=4)
        if zero:
            axes.axhline(0.0, color=BLACK, linewidth=0.6)
        axes.set(**axes_options)
        if len(curves) > 1:
            legend(axes, place)

    table = dict([x]) | {name: y for name, y, *_ in curves if name}
    return {"tables": {"": table}, "draw": draw}


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
