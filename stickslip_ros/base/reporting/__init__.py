# SPDX-License-Identifier: Apache-2.0
"""Quantities as people read them: a few digits, a unit of fitting size."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

from stickslip_ros.base.errors import libraries_for

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Colours of what is simulated, measured and the actuator's, in every picture.
SIMULATED, MEASURED, ACTUATOR = "#173b7a", "#d9502f", "#b5822f"
#: Standard deviations that a 95 % interval reaches to either side, in every result.
CONFIDENCE = 1.96
#: Least uncertainty of a length that is shown, m: the model is solved to ten times that.
_FINEST = 1e-12
_STEPS = ((1e-9, "n"), (1e-6, "µ"), (1e-3, "m"), (1.0, ""))


def scale_of(largest: float, unit: str) -> tuple[float, str]:
    """Return factor and name of the prefixed unit that suits values up to largest."""
    if unit == "N/m" and abs(largest) >= 1e5:
        return 1e-6, "N/µm"
    if unit not in ("m", "s"):
        return 1.0, unit
    fitting = [step for step in _STEPS if abs(largest) >= step[0]] or [_STEPS[0]]
    factor, prefix = fitting[-1]
    if unit == "m" and factor == 1e-6 and abs(largest) < 1e-5:
        factor, prefix = _STEPS[0]  # steps of a drive are nanometres
    return round(1.0 / factor, 0), prefix + unit


def format_si(
    value: float,
    unit: str,
    digits: int = 4,
    like: float | None = None,
    uncertainty: float | None = None,
) -> str:
    """Return a value as text with its unit and an SI prefix that suits it, or ``like`` if given.

    An uncertainty (same unit) follows after ± with two digits; the value gets as many decimals.
    """
    if not math.isfinite(value):
        return "–"
    factor, name = scale_of(value if like is None else like, unit)
    if uncertainty is not None and 0.0 < uncertainty < math.inf:
        uncertainty = max(uncertainty, _FINEST) if unit == "m" else uncertainty
        places = max(0, 1 - _exponent(factor * uncertainty, 2))
        pair = f"{factor * value:.{places}f} ± {factor * uncertainty:.{places}f}"
        return f"{pair} {name}".strip()
    if abs(factor * value) < 1e-6 and unit in ("m", "s"):
        return f"0 {name}"  # a millionth of a nanometre, and nothing below it
    size = abs(factor * (value if like is None else like))
    places = digits - 1 - _exponent(size, digits) if size > 0.0 else 0
    if not 0.0 < size < 1e7 or places > 9:
        return f"{factor * value:.{digits}g} {name}".strip()
    return f"{factor * value:.{max(0, places)}f} {name}".strip()


def _exponent(size: float, digits: int) -> int:
    """Return the power of ten of a positive number after rounding it to some digits."""
    return int(f"{size:.{digits - 1}e}".partition("e")[2])


def html_table(
    title: str, rows: Sequence[Sequence[str]], heading: Sequence[str] | None = None
) -> str:
    """Return an HTML table for a notebook: a title, and rows of a name and one value or more."""
    left = "style='text-align:left'"
    head = "".join(f"<th {left}>{escape(cell)}</th>" for cell in heading or ())
    lines = "".join(
        f"<tr><th {left}>{escape(name)}</th>"
        + "".join(f"<td {left}>{escape(value)}</td>" for value in values)
        + "</tr>"
        for name, *values in rows
    )
    top = f"<thead><tr>{head}</tr></thead>" if head else ""
    return f"<table><caption>{escape(title)}</caption>{top}<tbody>{lines}</tbody></table>"


def axes_or_new(axes: Axes | None) -> Axes:
    """Return the given axes of Matplotlib, or the axes of a new picture."""
    if axes is not None:
        return axes
    with libraries_for("a plot"):
        from matplotlib import pyplot

    return pyplot.subplots(layout="constrained")[1]


def draw_lines(
    axes: Axes | None,
    lines: Iterable[tuple[Any, Any, str, str, str]],
    x: str,
    y: str,
    title: str = "",
) -> Axes:
    """Draw lines (x, y, marker of Matplotlib, colour, name) into axes, or new ones.

    x, y are the names of the axes with the SI units of the values, such as "time (s)". They are
    shown with the prefix that suits, or with that of what has been drawn there before. Returns the
    axes.
    """
    drawn, lines = axes_or_new(axes), list(lines)
    (by_x, x), (by_y, y) = (
        _scale_for(label, before, [line[k] for line in lines])
        for k, (label, before) in enumerate(((x, drawn.get_xlabel()), (y, drawn.get_ylabel())))
    )
    for at, values, marker, colour, name in lines:
        size = 5 if marker == "o" else 2  # one point, or many
        shown = by_x * at, by_y * values
        drawn.plot(*shown, marker, color=colour, linewidth=1, markersize=size, label=name)
    drawn.set(xlabel=x, ylabel=y, title=title)
    drawn.grid(alpha=0.3)
    if len(drawn.lines) > 1:
        drawn.legend()
    return drawn


def _scale_for(label: str, before: str, values: Sequence[Any]) -> tuple[float, str]:
    """Return the factor of values in the SI unit of a label, and the label with its prefix."""
    name, _, unit = label.rstrip(")").partition(" (")
    if not unit:
        return 1.0, label
    for size, prefix in _STEPS:
        if before.endswith(f" ({prefix}{unit})"):
            return round(1.0 / size, 0), f"{name} ({prefix}{unit})"
    sizes = (abs(float(one)) for line in values if len(line) for one in (line.min(), line.max()))
    factor, prefixed = scale_of(max((one for one in sizes if one == one), default=0.0), unit)
    return factor, f"{name} ({prefixed})"


def to_json(value: Any) -> Any:
    """Convert to what JSON can hold: arrays to lists, numpy numbers to Python's, nan to None."""
    if isinstance(value, Mapping):
        return {key: to_json(inner) for key, inner in value.items()}
    if hasattr(value, "tolist"):  # of NumPy, which help texts do without
        return to_json(value.tolist())
    if isinstance(value, list | tuple):
        return [to_json(inner) for inner in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
