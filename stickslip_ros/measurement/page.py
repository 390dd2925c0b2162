# SPDX-License-Identifier: Apache-2.0
"""The report page: one HTML file with everything in it, plots to zoom into included.

plotly.js is several megabytes of text; it travels packed and the browser unpacks it. The page
forbids itself any request to elsewhere.
"""

from __future__ import annotations

import base64
import gzip
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from stickslip_ros.measurement.alignment import ComparisonError
from stickslip_ros.measurement.comparison import Comparison
from stickslip_ros.measurement.figures import figures
from stickslip_ros.measurement.verdict import Judgement
from stickslip_ros.reporting.page_frame import FRAME
from stickslip_ros.reporting.quantity import shown

_HEADINGS = {
    "overview": "Whole run",
    "step": "One step and its phases",
    "slip": "Backstep and ringing",
    "cycles": "Cycle by cycle",
}
#: Rows of the table of cycles.
_ROWS = 200


@dataclass(frozen=True)
class About:
    """What the page says beside the numbers."""

    command: str  #: that made the page
    parameters: Mapping[str, Any]  #: of the run, empty if they are not known
    units: Mapping[str, str]  #: of the parameters
    versions: Mapping[str, str]  #: of programs by name


def write_page(
    path: Path, found: Comparison, judgements: Sequence[Judgement], about: About
) -> None:
    """Write the page, all of it or nothing; OSError, or ComparisonError without plotly."""
    text = page(found, judgements, about)
    part = path.parent / f"{path.name}.part"
    try:
        part.write_text(text, encoding="utf-8")
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def page(found: Comparison, judgements: Sequence[Judgement], about: About) -> str:
    """Return the page as HTML. Raises ComparisonError if plotly is not installed."""
    plots = figures(found)
    parts = {
        "TITLE": escape(f"{found.run.source} and {found.measurement.source}"),
        "RUN": escape(found.run.source),
        "MEASUREMENT": escape(found.measurement.source),
        "VERDICT": _verdict(judgements),
        "CARDS": _cards(found),
        "DIFFERING": _differing(found),
        "METRICS": _metrics(found),
        "LIMITS": _limits(judgements),
        "PLOTS": "".join(_section(name) for name in plots),
        "CYCLES": _cycle_rows(found),
        "NOTES": "".join(f"<li>{escape(note)}</li>" for note in found.notes()),
        "PARAMETERS": _parameters(about),
        "VERSIONS": _pairs(about.versions),
        "COMMAND": escape(about.command),
        "DATA": json.dumps(plots, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c"),
        "LIBRARY": _library(),
    }
    text = FRAME
    for name, part in parts.items():
        text = text.replace(f"@{name}@", part, 1)
    return text


@cache
def _library() -> str:
    try:
        from plotly.offline import get_plotlyjs
    except ImportError:
        raise ComparisonError(
            "the report page needs plotly; install it: pip install plotly"
        ) from None
    packed = gzip.compress(get_plotlyjs().encode(), compresslevel=9, mtime=0)
    return base64.b64encode(packed).decode()


def _verdict(judgements: Sequence[Judgement]) -> str:
    if not judgements:
        return '<span class="badge plain">no limits set</span>'
    failed = sum(not judgement.kept for judgement in judgements)
    if failed:
        return f'<span class="badge bad">{failed} of {len(judgements)} limits exceeded</span>'
    return f'<span class="badge good">all {len(judgements)} limits kept</span>'


def _cards(found: Comparison) -> str:
    place = found.alignment
    offset = shown(place.offset, "s", 6) if found.fits.offset else "not fitted"
    spread = place.offset_error
    cards = [
        ("RMSE", shown(found.rmse, "m"), f"{100.0 * found.normalised:.3g} % of the range"),
        ("largest difference", shown(found.largest, "m"), f"at {shown(found.largest_at, 's', 5)}"),
        ("sensor noise", shown(found.noise, "m"), "standard deviation"),
        ("clock offset", offset, f"± {shown(spread, 's', 2)}" if math.isfinite(spread) else ""),
    ]
    if found.fits.drift:
        cards.append(("clock drift", f"{1e6 * place.drift:.4g} ppm", "fitted"))
    if found.fits.gain:
        cards.append(("sensor gain", f"{place.gain:.6g}", "fitted"))
    return "".join(
        f'<div class="card"><div class="what">{escape(what)}</div><div class="value">'
        f'{escape(value)}</div><div class="more">{escape(more)}</div></div>'
        for what, value, more in cards
    )


def _differing(found: Comparison) -> str:
    told = [metric for metric in found.metrics if metric.differs is not None]
    if not told:
        return "No metric of the steps can be told from these data."
    if not found.differing:
        return "No metric differs by more than its tolerance."
    return f"What differs: <b>{escape(', '.join(found.differing))}</b>."


def _metrics(found: Comparison) -> str:
    rows = []
    for metric in found.metrics:
        size = max((abs(v) for v in (metric.run, metric.measured) if math.isfinite(v)), default=0.0)
        if metric.differs is None:
            kind, judgement = "", metric.why_missing or "cannot be told"
        else:
            kind, judgement = ("differs", "differs") if metric.differs else ("same", "agrees")
        values = [
            shown(value, metric.unit, 5, like=size or 1.0)
            for value in (metric.run, metric.measured)
        ]
        values += [shown(value, metric.unit, 3) for value in (metric.difference, metric.tolerance)]
        cells = "".join(
            f'<td class="number{" wide" if k == 3 else ""}">{escape(value)}</td>'
            for k, value in enumerate(values)
        )
        rows.append(
            f'<tr class="{kind}"><th scope="row">{escape(metric.name)}</th>{cells}'
            f"<td>{escape(judgement)}</td></tr>"
        )
    return "".join(rows)


def _limits(judgements: Sequence[Judgement]) -> str:
    if not judgements:
        return ""
    rows = "".join(
        f'<tr class="{"same" if j.kept else "differs"}"><th scope="row">{escape(j.what)}</th>'
        f'<td class="number">{escape(shown(j.found, j.unit))}</td>'
        f'<td class="number">{escape(shown(j.allowed, j.unit))}</td>'
        f"<td>{_outcome(j)}</td></tr>"
        for j in judgements
    )
    return (
        '<section><h2>Limits</h2><div class="scroll"><table><thead><tr><th>quantity</th>'
        '<th class="number">found</th><th class="number">allowed</th><th></th></tr></thead>'
        f"<tbody>{rows}</tbody></table></div></section>"
    )


def _outcome(judgement: Judgement) -> str:
    if judgement.kept:
        return "kept"
    return "exceeded" if judgement.found > judgement.allowed else "cannot be told"


def _section(name: str) -> str:
    return (
        f'<section class="figure"><h2>{_HEADINGS[name]}</h2><div class="plot" id="{name}"></div>'
        "</section>"
    )


def _cycle_rows(found: Comparison) -> str:
    table = found.cycles
    if table is None:
        return ""

    def nano(value: float) -> str:
        return f'<td class="number">{1e9 * value:.2f}</td>' if np.isfinite(value) else "<td></td>"

    columns = (
        table.step, table.measured_step, table.measured_step - table.step,
        table.backstep, table.measured_backstep, table.measured_backstep - table.backstep,
        table.rmse,
    )  # fmt: skip
    count = len(table.slip)
    rows = "".join(
        f'<tr><td class="number">{k + 1}</td>{"".join(nano(column[k]) for column in columns)}</tr>'
        for k in range(min(count, _ROWS))
    )
    more = f", the first {_ROWS} of {count}" if count > _ROWS else ""
    heads = (
        "cycle",
        "step",
        "measured",
        "difference",
        "backstep",
        "measured",
        "difference",
        "RMSE",
    )
    head = "".join(f'<th class="number">{name}</th>' for name in heads)
    return (
        f"<section><details><summary>Table of cycles{more} (nm)</summary>"
        f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>'
        "</div></details></section>"
    )


def _parameters(about: About) -> str:
    if not about.parameters:
        return "<p>The run does not tell its parameters.</p>"
    named = {
        name: f"{value:g} {about.units.get(name, '')}".strip()
        if isinstance(value, float)
        else str(value)
        for name, value in about.parameters.items()
    }
    return _pairs(named)


def _pairs(values: Mapping[str, str]) -> str:
    items = "".join(
        f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd></div>"
        for name, value in values.items()
    )
    return f'<dl class="pairs">{items}</dl>'
