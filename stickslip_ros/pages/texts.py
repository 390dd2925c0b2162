# SPDX-License-Identifier: Apache-2.0
"""Comparison, analysis and fit as text for a terminal, and the remarks in a fitted file."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from stickslip_ros.reporting import shown
from stickslip_ros.reporting.terminal import coloured, lines_of, micro

if TYPE_CHECKING:  # a command loads what its own result needs
    from stickslip_ros.identification import Fit
    from stickslip_ros.measurement import Comparison, Judgement
    from stickslip_ros.traces.runs import Run


def comparison_text(found: Comparison, judgements: Sequence[Judgement]) -> str:
    """Return differences, metrics and limits."""
    place = found.alignment
    lines = [
        f"{'RMSE':<18} {shown(found.rmse, 'm')}, {100.0 * found.normalised:.3g} % of the range",
        f"{'  of the steps':<18} {shown(found.step_rmse, 'm')}, adding up from step to step",
        f"{'  of the shape':<18} {shown(found.shape_rmse, 'm')}, within the cycles",
        f"{'largest':<18} {shown(found.largest, 'm')} at {shown(found.largest_at, 's', 6)}",
        f"{'sensor noise':<18} {shown(found.noise, 'm')}",
    ]
    if found.fits.offset:
        error = shown(place.offset_error, "s", 2)
        lines.append(f"{'clock offset':<18} {shown(place.offset, 's', 7)} ± {error}")
    if found.fits.drift:
        lines.append(f"{'clock drift':<18} {1e6 * place.drift:.4g} ppm")
    if found.fits.gain:
        lines.append(f"{'sensor gain':<18} {place.gain:.6g}")
    lines.append(
        f"\n{'metric':<18} {'run':>12} {'measured':>12} {'difference':>12} {'tolerance':>12}"
    )
    for metric in found.metrics:
        if metric.differs is None:
            lines.append(f"{metric.name:<18} {metric.why_missing or 'not determined'}")
            continue
        values = [shown(value, metric.unit, 5) for value in (metric.run, metric.measured)]
        values += [shown(value, metric.unit, 3) for value in (metric.difference, metric.tolerance)]
        cells = " ".join(f"{value:>12}" for value in values)
        lines.append(f"{metric.name:<18} {cells}  {_verdict(metric.differs)}")
    lines += ["", *found.notes()]
    for judgement in judgements:
        good = judgement.kept
        word = coloured("kept", "green") if good else coloured("EXCEEDED", "bold red")
        lines.append(f"{word}: {judgement}")
    return "\n".join(lines)


def _verdict(differs: bool) -> str:
    return coloured("DIFFERS", "bold red") if differs else coloured("agrees", "green")


def analysis_text(runs: Sequence[Run], found: Run) -> str:
    """Return a line for each run, and the analysis of the longest one."""
    return "\n".join([*map(_run_line, runs), _analysis_lines(found)])


def _run_line(run: Run) -> str:
    way = "forward" if run.direction > 0 else "backward"
    doubt = "" if run.determined else ", not determined"
    return (
        f"{run.steps} steps {way} at {run.frequency:.6g} Hz, {run.start:.9g} s to {run.end:.9g} s"
        f"{doubt}: {1e9 * run.step_size:.3f} nm a step, "
        f"standard error {1e9 * run.step_size_error:.3f} nm, "
        f"from cycles {run.first_cycle + 1} to {run.steps}"
    )


def _analysis_lines(found: Run) -> str:
    balance = found.balance

    def nano(length: float) -> str:
        return "not measurable" if math.isnan(length) else f"{1e9 * length:.3f} nm"

    def mean(length: float, error: float) -> str:
        if math.isnan(error):
            return nano(length)
        return f"{nano(length)}, standard error {nano(error)}"

    rings = not math.isnan(found.ringing_frequency)
    rows = [
        ("cycles", f"{len(found.starts)} of {found.period:g} s, from {found.starts[0]:g} s"),
        ("step size", mean(found.step_size, found.step_size_error)),
        ("backstep", mean(found.backstep, found.backstep_error)),
        ("ringing", f"{found.ringing_frequency:.1f} Hz" if rings else "none visible"),
        (
            "decay",
            f"{found.decay:.1f} 1/s, {found.damping_ratio:.4f} of critical" if rings else "-",
        ),
        ("mean speed", f"{1e6 * found.mean_speed:.3f} {micro()}m/s"),
    ]
    if math.isnan(balance.excitation):
        rows.append(("Eq. 9", "needs the deflection of the actuator, which is not known"))
        return lines_of(rows)
    rows += [
        ("excitation", nano(balance.excitation)),
        ("regained", nano(balance.regained)),
        ("left (Eq. 9)", nano(balance.left)),
        ("0-amplitude", nano(balance.zero_amplitude)),
        ("remainder", nano(balance.remainder)),
    ]
    return lines_of(rows)


def fit_sources(found: Fit) -> list[str]:
    """Return the names of the measurements."""
    return [*(run.source for run in found.runs), *(one.source for one in found.curves)]


def fit_remarks(found: Fit) -> str:
    """Return the comments at the top of a fitted file."""
    lines = [f"identified from {', '.join(fit_sources(found))}; 95 % intervals, SI units"]
    if not found.complete:
        lines = ["INTERRUPTED: the best so far, not the result of an identification"]
    for name, one in found.parameters.items():
        low, high = (("-" if end is None else f"{end:.4g}") for end in (one.low, one.high))
        lines.append(f"{name}: {one.value:.5g} {one.unit}, from {low} to {high}")
    lines += found.unknown
    if found.ensemble:
        lines.append(found.ensemble.comment())
    if found.misfit:
        lines.append(f"MISFIT: {found.misfit.text}")
    return "".join(f"# {line}\n" for line in lines)


def fit_text(found: Fit) -> str:
    """Return values, intervals, runs and curves, and what is not known."""
    lines = [f"{'parameter':<16} {'value':>14} {'low (95 %)':>14} {'high (95 %)':>14}"]
    for name, one in found.parameters.items():
        ends = [
            "–" if end is None else shown(end, one.unit, 4, like=one.value)
            for end in (one.low, one.high)
        ]
        mark = "" if one.determined or not found.complete else "  not determined"
        if one.at_bound:
            mark = "  on a bound of the search"
        value = shown(one.value, one.unit, 4)
        lines.append(f"{name:<16} {value:>14} {ends[0]:>14} {ends[1]:>14}{mark}")
    lines.append("")
    for run in found.runs:
        hum = f", hum of {' and '.join(f'{f:g}' for f in run.mains)} Hz" if run.mains else ""
        lines.append(
            f"{run.source}: {abs(run.steps)} steps, noise {shown(run.noise, 'm', 3)} a sample{hum}"
        )
    for curve in found.curves:
        lines.append(f"{curve.source}: {curve.points} points")
    lines += found.unknown
    if found.next:
        lines.append(f"next: {found.next.text}")
    if found.laws:
        lines += ["", f"{'law, best first':<16} {'constants':>14} {'score':>14} {'left':>14}"]
    for law in found.laws:
        left = shown(law.residual, "m", 3)
        lines.append(f"{law.law:<16} {len(law.parameters):>14} {law.score:>14.1f} {left:>14}")
    if found.laws_alike:
        lines.append(found.laws_alike)
    return "\n".join(lines)
