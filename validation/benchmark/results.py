# SPDX-License-Identifier: Apache-2.0
"""Results of the benchmark as text, as one JSON object and as a picture."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stickslip_ros.base.files import whole_file
from stickslip_ros.base.reporting import to_json
from validation.benchmark.measuring import LIMIT, CaseResult, Measured, Point
from validation.benchmark.methods import METHODS, OURS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MICRO, _NANO = 1e6, 1e9
#: Errors below this are rounding, nm: drawn at the edge.
_FLOOR = 1e-9
_COLOURS = ("black", "#1f77b4", "#17becf", "#2ca02c", "#9467bd", "#d62728", "#ff7f0e", "#e377c2")
_MARKERS = "os^vDPX<>"


def table(result: CaseResult) -> str:
    """Return the table of one case for people."""
    case = result.case
    lines = [
        f"{case.title}: the reference and our solver at its finest differ by "
        f"{_NANO * result.gap:.0e} nm a cycle",
        f"{'method':<15}{'setting':>9}{'µs per cycle':>14}{'min .. max':>24}"
        f"{'x real time':>13}{'error (nm)':>12}{'to ours':>10}",
    ]
    for name, one in result.measured.items():
        title = METHODS[name].title
        if one.missing:
            lines.append(f"{title:<15} missing: {one.missing}")
            continue
        point = one.quoted
        if point is None or not point.times:
            lines.append(f"{title:<15} no setting is within {_NANO * LIMIT:g} nm a cycle")
            continue
        chance = "*" if name != OURS and point is not one.dependable else " "
        spread = f"{_MICRO * min(point.times):.4g} .. {_MICRO * max(point.times):.4g}"
        ratio = result.ratio(name)
        lines.append(
            f"{title:<15}{point.setting:>9.0e}{_MICRO * point.median:>14.4g}{spread:>24}"
            f"{1.0 / case.frequency / point.median:>13.3g}{_NANO * point.error:>12.1e}"
            f"{'' if ratio is None else f'{ratio:.2f}':>9}{chance}"
        )
    return "\n".join(lines)


def summary(results: Sequence[CaseResult]) -> str:
    """Return the ratios of all cases."""
    lines = [
        f"time by ours, peers at their fastest setting within {_NANO * LIMIT:g} nm a cycle",
        f"{'case':<22}{'fastest peer':>13}  {'':<15}{'dependable':>10}  {'':<15}"
        f"{'SciPy LSODA':>11}{'ours at the limit':>19}",
    ]
    for result in results:
        peer, sound = result.fastest_peer, result.fastest_dependable_peer
        loose = result.measured[OURS].fastest(LIMIT)
        lines.append(
            f"{result.case.title:<22}{_times(result.ratio(peer)):>13}  {_title(peer):<15}"
            f"{_times(result.ratio(sound, dependable=True)):>10}  {_title(sound):<15}"
            f"{_times(result.scipy_ratio):>11}"
            f"{'' if loose is None else f'{_MICRO * loose.median:.2f} µs':>19}"
        )
    lines += [
        "* right by chance: a tighter setting is not within the limit. `dependable` leaves these",
        "  out. `ours at the limit`: our fastest tolerance within the limit the peers are held to.",
    ]
    return "\n".join(lines)


def as_json(results: Sequence[CaseResult]) -> dict[str, Any]:
    """Return everything that was measured, in SI units; None where there is no value."""
    return {
        "limit": LIMIT,
        "cases": [
            {
                "name": result.case.name,
                "preload": result.case.preload,
                "mass": result.case.mass,
                "frequency": result.case.frequency,
                "reference_gap": to_json(result.gap),
                "reference_convergence": to_json(result.reference_gap),
                "fastest_peer": result.fastest_peer,
                "fastest_peer_by_ours": result.ratio(result.fastest_peer),
                "dependable_peer": result.fastest_dependable_peer,
                "dependable_peer_by_ours": result.ratio(result.fastest_dependable_peer, True),
                "scipy_lsoda_by_ours": result.scipy_ratio,
                "methods": [_method(result, one) for one in result.measured.values()],
            }
            for result in results
        ],
    }


def _method(result: CaseResult, one: Measured) -> dict[str, Any]:
    quoted = one.quoted if one.points else None
    return {
        "name": one.method,
        "title": METHODS[one.method].title,
        "missing": one.missing or None,
        "quoted": _point(result, quoted) if quoted else None,
        "by_ours": result.ratio(one.method) if quoted else None,
        "by_chance": bool(quoted) and one.method != OURS and quoted is not one.dependable,
        "points": [_point(result, point) for point in one.points],
    }


def _point(result: CaseResult, point: Point) -> dict[str, Any]:
    timed = bool(point.times)
    return {
        "setting": point.setting,
        "error": to_json(point.error),
        "time_per_cycle": point.median if timed else None,
        "fastest": min(point.times) if timed else None,
        "slowest": max(point.times) if timed else None,
        "real_time_factor": 1.0 / result.case.frequency / point.median if timed else None,
        "cycles": point.cycles,
        "repeats": len(point.times),
    }


def _times(ratio: float | None) -> str:
    return "-" if ratio is None else f"{ratio:.1f}" if ratio < 100.0 else f"{ratio:.0f}"


def _title(name: str | None) -> str:
    return "" if name is None else METHODS[name].title


def plot(path: Path, results: Sequence[CaseResult]) -> None:
    """Write a PNG with the results of one run, error against cost; WriteError if it cannot be."""
    from matplotlib.figure import Figure

    columns = min(len(results), 5) or 1
    rows = math.ceil(len(results) / columns)
    figure = Figure(figsize=(max(4.2 * columns, 8.0), 4.4 * rows + 1.2), layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False, sharey=True)
    for panel, result in zip(panels.flat, results, strict=False):
        _panel(panel, result)
    for panel in panels.flat[len(results) :]:
        panel.set_visible(False)
    for row in panels:
        row[0].set_ylabel("error per cycle (nm)")
    for column in range(columns):
        panels[-1, column].set_xlabel("time per cycle (µs)")
    drawn = {
        label: line
        for panel in panels.flat
        for line, label in zip(*panel.get_legend_handles_labels(), strict=True)
    }
    figure.legend(drawn.values(), drawn.keys(), loc="outside lower center", ncols=5)
    figure.suptitle(
        "Error against cost, each method at several tolerances (ringed: the one that is quoted)"
    )
    with whole_file(path) as part:
        figure.savefig(part, dpi=100, format="png")


def _panel(axes: Axes, result: CaseResult) -> None:
    for number, (name, entry) in enumerate(METHODS.items()):
        one = result.measured.get(name)
        points = [point for point in one.points if point.times] if one else []
        if one is None or not points:
            continue
        colour = _COLOURS[number % len(_COLOURS)]
        axes.plot(
            [_MICRO * point.median for point in points],
            [max(_NANO * point.error, _FLOOR) for point in points],
            marker=_MARKERS[number % len(_MARKERS)],
            markersize=4,
            color=colour,
            linewidth=2.2 if name == OURS else 1.1,
            label=entry.title,
            zorder=3 if name == OURS else 2,
        )
        quoted = one.quoted
        if quoted is not None and quoted.times:
            axes.plot(
                [_MICRO * quoted.median],
                [max(_NANO * quoted.error, _FLOOR)],
                "o",
                markersize=11,
                markerfacecolor="none",
                markeredgecolor=colour,
                zorder=4,
            )
    axes.axhline(_NANO * LIMIT, color="grey", linestyle="--", linewidth=1.0)
    axes.set(xscale="log", yscale="log", title=result.case.title)
    axes.grid(alpha=0.3)
