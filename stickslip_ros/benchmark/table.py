# SPDX-License-Identifier: Apache-2.0
"""Results of the benchmark as text and as one JSON object."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from stickslip_ros.benchmark.measuring import LIMIT, CaseResult, Measured, Point
from stickslip_ros.benchmark.methods import METHODS, OURS

_MICRO, _NANO = 1e6, 1e9


def table(result: CaseResult) -> str:
    """Return the table of one case for people."""
    case = result.case
    lines = [
        f"{case.title}: the reference and our kernel at its finest differ by "
        f"{_NANO * result.gap:.0e} nm a cycle",
        f"{'method':<15}{'setting':>9}{'us per cycle':>14}{'min .. max':>24}"
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
            f"{'' if loose is None else f'{_MICRO * loose.median:.2f} us':>19}"
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
                "reference_gap": _finite(result.gap),
                "reference_convergence": _finite(result.reference_gap),
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
        "error": _finite(point.error),
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


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
