# SPDX-License-Identifier: Apache-2.0
"""Pages from templates: one HTML file with everything in it, in ``templates/``.

Their plots are plain data for plotly.js: lines with few points, axes, layouts.
"""

from __future__ import annotations

import base64
import gzip
import json
import platform
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import jinja2
import numpy as np
import scipy
from markupsafe import Markup

from stickslip_ros.base.arrays import Array
from stickslip_ros.base.errors import StickslipError, printable
from stickslip_ros.base.reporting import format_si
from stickslip_ros.version import __version__

Figure = dict[str, Any]

#: Rows that the table of a page has at most.
_ROWS = 400


class PageError(StickslipError):
    """A page needs a library that is not installed; the text names it."""


class PlotPlace(NamedTuple):
    """Where ``figures.html`` puts a plot."""

    name: str  #: of its place, see `plot_parts`
    heading: str
    alternative: str  #: description of the plot, for screen readers
    figure: Any = None  #: as plain data for plotly.js


class ResultPage(NamedTuple):
    """The page of a result: a template, its plots, and its other parts by name."""

    template: str
    plots: Sequence[PlotPlace]
    parts: Mapping[str, Any]

    def html(self, command: str) -> str:
        """Return the page; command made the result. Raises PageError without plotly."""
        drawn = plot_parts({p.name: p.figure for p in self.plots}) if self.plots else {}
        parts = {"versions": versions(), "command": command, **self.parts, **drawn}
        return page(self.template, plots=self.plots, **parts)


def result_page(
    title: str,
    text: str,
    picture: bytes | None,
    heading: Sequence[str],
    rows: Sequence[Sequence[Any]],
) -> ResultPage:
    """Return the page of a result that has a text, a table, and a picture (SVG) or none."""
    shown = [["" if cell is None else cell for cell in row] for row in rows[:_ROWS]]
    parts = {
        "title": title, "text": text, "heading": heading, "rows": shown,
        "left_out": len(rows) - len(shown),
        "picture": picture and f"data:image/svg+xml;base64,{base64.b64encode(picture).decode()}",
    }  # fmt: skip
    return ResultPage("result.html", [], parts)


def versions() -> dict[str, str]:
    """Return the versions of the programs that a result comes from, by name."""
    return {
        "stickslip_ros": __version__,
        "Python": platform.python_version(),
        "NumPy": np.__version__,
        "SciPy": scipy.__version__,
    }


def page(template: str | Path, **parts: Any) -> str:
    """Fill a template; texts other than Markup are escaped, a missing part is an error.

    A template is given by its name in ``templates/``, or as a file that may use those. In templates
    ``value | quantity("m", 4)`` is `format_si`.
    """
    if isinstance(template, Path):
        return _environment().from_string(template.read_text(encoding="utf-8")).render(parts)
    return _environment().get_template(template).render(parts)


@cache
def _environment() -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent / "templates"),
        autoescape=True,
        finalize=_finalized,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["quantity"] = format_si
    return environment


def _finalized(value: Any) -> Any:
    """Return a value for a page; texts that are no Markup may come out of foreign files."""
    return printable(value, "\n\t") if type(value) is str else value


def plot_parts(figures: Mapping[str, Any]) -> dict[str, Markup]:
    """Return the parts for ``plots.html``: figures of plotly.js by the id of their place, packed.

    Raises PageError if plotly is not installed.
    """
    text = json.dumps(figures, allow_nan=False, separators=(",", ":"))
    return {"data": Markup(text.replace("<", "\\u003c")), "library": plotly_script()}


@cache
def plotly_script() -> Markup:
    try:
        from plotly.offline import get_plotlyjs
    except ImportError:
        raise PageError("the report page needs plotly; install it: pip install plotly") from None
    # Level 9 would keep Ctrl-C waiting for 0.3 s, for one part in a hundred.
    packed = gzip.compress(get_plotlyjs().encode(), compresslevel=5, mtime=0)
    return Markup(base64.b64encode(packed).decode())


# -- parts of plots


def line_of(
    x: Array, y: Array, name: str, color: str, unit: str, x_unit: str, **more: Any
) -> Figure:
    """Return a line through points; unit and x_unit are the units of y and x."""
    return {
        "type": "scatter",
        "mode": "lines",
        "x": digits_of(x),
        "y": digits_of(y),
        "name": name,
        "line": {"color": color, "width": 1.5},
        "hovertemplate": f"%{{x}} {x_unit}, %{{y}} {unit}",
        **more,
    }


def digits_of(values: Array) -> list[float | None]:
    """Round values to seven digits of the largest, which is all that a plot can show."""
    finite = values[np.isfinite(values)]
    size = float(np.max(np.abs(finite), initial=0.0))
    places = 7 - int(np.ceil(np.log10(size))) if size > 0.0 else 0
    rounded = np.round(values, places).tolist()
    return [value if np.isfinite(value) else None for value in rounded]


def axis_of(title: str, **more: Any) -> Figure:
    """Return an axis with a title."""
    return {"title": {"text": title, "standoff": 6}, "automargin": True, **more}


def layout_of(height: int, **more: Any) -> Figure:
    """Return the frame of a plot of a height in pixels."""
    return {
        "height": height,
        "margin": {"l": 60, "r": 12, "t": 34, "b": 44},
        "legend": {"orientation": "h", "y": 1.0, "yanchor": "bottom", "x": 0},
        "hovermode": "closest",
        "dragmode": "zoom",
        **more,
    }


def stretch_of(start: float, end: float, tint: str, **more: Any) -> Figure:
    """Return a tinted stretch of x, over the whole height unless more says which."""
    return {
        "type": "rect", "xref": "x", "yref": "paper", "x0": start, "x1": end, "y0": 0, "y1": 1,
        "fillcolor": tint, "line": {"width": 0}, "layer": "below", **more,
    }  # fmt: skip


def thin_columns(t: Array, *columns: Array, count: int) -> tuple[Array, ...]:
    """Reduce t and the columns to about count samples: the lowest and highest of each interval.

    The extremes of every column stay, so lines look as they do with all samples.
    """
    if len(t) <= count:
        return (t, *columns)
    stretches = np.array_split(np.arange(len(t)), max(1, count // (2 * len(columns))))
    kept = {0, len(t) - 1}
    for stretch in stretches:
        for column in columns:
            part = column[stretch]
            kept |= {int(stretch[np.argmin(part)]), int(stretch[np.argmax(part)])}
    at = np.array(sorted(kept))
    return (t[at], *(column[at] for column in columns))
