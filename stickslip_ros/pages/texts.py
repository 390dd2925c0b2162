# SPDX-License-Identifier: Apache-2.0
"""Texts that commands print besides the report of a result, and the remarks in a fitted file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from stickslip_ros.reporting.terminal import nanometres, style_text

if TYPE_CHECKING:  # a command loads what its own result needs
    from stickslip_ros.identification import Fit
    from stickslip_ros.measurement import Comparison, Judgement
    from stickslip_ros.traces.runs import Run


def comparison_text(found: Comparison, judgements: Sequence[Judgement]) -> str:
    """Return the report of a comparison, and whether limits are kept."""
    lines = [found.report()]
    for judgement in judgements:
        good = judgement.kept
        word = style_text("kept", "green") if good else style_text("EXCEEDED", "bold red")
        lines.append(f"{word}: {judgement}")
    return "\n".join(lines)


def analysis_text(runs: Sequence[Run], found: Run) -> str:
    """Return a line for each run, and the report of one, which is named if there are more."""
    named = [f"of the {found.steps} steps from {found.span}:"] if len(runs) > 1 else []
    return "\n".join([*map(_run_line, runs), *named, found.report()])


def _run_line(run: Run) -> str:
    way = "forward" if run.direction > 0 else "backward"
    doubt = "" if run.determined else ", not determined"
    size = nanometres(run.step_size, run.step_size_error)
    return (
        f"{run.steps} steps {way} at {run.frequency:.5g} Hz, {run.span}{doubt}: "
        f"a step is {size}, from cycles {run.first_cycle + 1} to {run.steps}"
    )


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
