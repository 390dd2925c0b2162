# SPDX-License-Identifier: Apache-2.0
"""The page of an identification: the content of the template ``identify.html``, with its plots."""

from __future__ import annotations

import math

import numpy as np

from stickslip_ros.base.arrays import Array
from stickslip_ros.base.reporting import MEASURED, SIMULATED, format_si, scale_of
from stickslip_ros.base.reporting.page import (
    Figure,
    PlotPlace,
    ResultPage,
    axis_of,
    digits_of,
    layout_of,
    line_of,
)
from stickslip_ros.cli.pages.measured import RESIDUAL, motion_and_residual
from stickslip_ros.measurement.identification.curve import UNITS
from stickslip_ros.measurement.identification.fit import Fit, FittedCurve, FittedRun
from stickslip_ros.measurement.identification.free import unit_of
from stickslip_ros.measurement.identification.intervals import listed
from stickslip_ros.physics.parameters import Parameters, parameter

LIMIT = "#c46a1b"
#: Points of a line over a whole run; phases of a cycle; profiles beside each other.
_POINTS, _PHASES, _ABREAST = 6000, 100, 3
#: Points of the line of a profile; gap below a row of profiles, for their names.
_POINTS_BETWEEN, _GAP = 60, 0.2
#: The highest rise of the deviance that is shown.
_SHOWN = 8.0
#: What a fit rests on, shown whatever it is; of these groups also what somebody has set.
_ALWAYS = ("model", "preload", "mass", "gain", "waveform", "amplitude", "frequency", "slewrate")
_PHYSICS = ("friction", "runner", "actuator", "drive", "sensor")
_FOLDED = (
    "What the fit leaves at each place of the cycle, and its mean over the cycles. The slip is at "
    "0 and 1. Noise has a mean near 0 everywhere."
)
_PROFILES = (
    "How far the deviance rises when one parameter is held and all others follow. The interval "
    "ends where the curve crosses the line."
)


def fit_page(found: Fit) -> ResultPage:
    """Return the page of a fit."""
    values, usual = found.base.flat(), Parameters().flat()
    known = {
        name: f"{value:g} {parameter(name).unit}".strip() if isinstance(value, float) else value
        for name, value in values.items()
        if name not in found.parameters
        and (name in _ALWAYS or (value != usual[name] and parameter(name).group in _PHYSICS))
    }
    parts = {"found": found, "sources": found.sources, "known": known}
    return ResultPage("identify.html", _plots(found), parts)


def _plots(found: Fit) -> list[PlotPlace]:
    """Return the plots with their descriptions."""
    plots: list[PlotPlace] = []
    for k, run in enumerate(found.runs):
        text = (
            f"Measured position and fit over {format_si(float(np.ptp(run.t)), 's')}, and what the "
            f"fit leaves: {format_si(run.residual, 'm', 3)} (root mean square)."
        )
        lines = [(run.measured, "measured", MEASURED), (run.measured - run.left, "fit", SIMULATED)]
        residuals = [(run.left, "measured − fit", RESIDUAL)]
        figure = motion_and_residual(run.t - run.t[0], lines, residuals)
        plots.append(PlotPlace(f"run-{k}", f"{run.source}: data and fit", text, figure))
        if np.isfinite(run.cycle).any():
            heading = f"{run.source}: residuals over the drive cycle"
            plots.append(PlotPlace(f"folded-{k}", heading, _FOLDED, _folded(run)))
    for k, curve in enumerate(found.curves):
        metrics, varied = (listed([one.replace("_", " ") for one in names])
                           for names in (curve.measured, curve.varied))  # fmt: skip
        text = (
            f"{curve.points} points of {metrics} over {varied}, with their standard deviations, "
            "and the fit."
        )
        plots.append(PlotPlace(f"curve-{k}", f"{curve.source}: table and fit", text, _curve(curve)))
    if found.profiles:
        plots.append(PlotPlace("profiles", "Profiles", _PROFILES, _profiles(found)))
    return plots


def _folded(run: FittedRun) -> Figure:
    inside = np.isfinite(run.cycle)
    place, left = np.mod(run.cycle[inside], 1.0), run.left[inside]
    phase = np.minimum((place * _PHASES).astype(np.int64), _PHASES - 1)
    count = np.bincount(phase, minlength=_PHASES)
    means = np.bincount(phase, left, minlength=_PHASES) / np.maximum(count, 1)
    means[count == 0] = np.nan
    factor, unit = scale_of(float(np.max(np.abs(left))), "m")
    some = np.linspace(0, len(place) - 1, min(len(place), _POINTS)).astype(np.int64)
    data = [
        line_of(
            place[some], factor * left[some], "residuals", RESIDUAL, unit, "cycles",
            mode="markers", marker={"size": 3, "color": RESIDUAL, "opacity": 0.35},
        ),
        line_of((np.arange(_PHASES) + 0.5) / _PHASES, factor * means, "mean", MEASURED, unit,
                "cycles"),
    ]  # fmt: skip
    layout = layout_of(
        340, xaxis=axis_of("place in the drive cycle"), yaxis=axis_of(f"residual ({unit})")
    )
    return {"data": data, "layout": layout}


def _curve(curve: FittedCurve) -> Figure:
    """Draw each metric over the first parameter that varies, one below the other."""
    name, x = next(iter(curve.varied.items()))
    order = np.argsort(x, kind="stable")
    data, axes = [], {}
    count = len(curve.measured)
    for k, (metric, values) in enumerate(curve.measured.items()):
        finite = values[np.isfinite(values)]
        factor, unit = scale_of(float(np.max(np.abs(finite), initial=0.0)), UNITS[metric])
        axis = "y" if k == 0 else f"y{k + 1}"
        error = {"type": "data", "array": digits_of(factor * curve.deviations[metric][order])}
        words = metric.replace("_", " ")
        data += [
            line_of(x[order], factor * values[order], f"{words}, measured", MEASURED, unit,
                    parameter(name).unit, mode="markers", marker={"size": 7, "color": MEASURED},
                    error_y=error, yaxis=axis),
            line_of(x[order], factor * curve.fitted[metric][order], f"{words}, fit", SIMULATED,
                    unit, parameter(name).unit,
                    mode="lines" if len(curve.varied) == 1 else "markers",
                    marker={"size": 5, "symbol": "x", "color": SIMULATED}, yaxis=axis),
        ]  # fmt: skip
        top = 1.0 - k / count
        axes[f"yaxis{k + 1 if k else ''}"] = axis_of(
            f"{words} ({unit})", domain=[top - 0.88 / count, top]
        )
    unit = parameter(name).unit
    x_axis = axis_of(
        f"{name} ({unit})" if unit else name, anchor="y" if count == 1 else f"y{count}"
    )
    return {"data": data, "layout": layout_of(120 + 260 * count, xaxis=x_axis, **axes)}


def _profiles(found: Fit) -> Figure:
    data, frame = [], {}
    count = len(found.profiles)
    rows = math.ceil(count / _ABREAST)
    tall = (1.0 + _GAP) / rows  # a row with the gap below it
    for k, profile in enumerate(found.profiles):
        number = "" if k == 0 else str(k + 1)
        row, column = divmod(k, _ABREAST)
        left, top = column / _ABREAST, 1.0 - row * tall
        unit = unit_of(profile.name)
        values = profile.values
        factor, named = scale_of(float(np.median(values)), unit)
        seen = profile.rise <= _SHOWN
        for drawn, rise, mode in (
            (values[seen], profile.rise[seen], "markers"),
            (*_interpolated(values[seen], profile.rise[seen]), "lines"),
        ):
            data.append(
                line_of(factor * drawn, rise, profile.name, SIMULATED, "", named, mode=mode,
                        marker={"size": 5, "color": SIMULATED}, showlegend=False,
                        xaxis=f"x{number}", yaxis=f"y{number}")
            )  # fmt: skip
        ends = factor * values[seen][[0, -1]]
        data.append(
            line_of(ends, np.full(2, profile.limit), "95 %", LIMIT, "", named, showlegend=k == 0,
                    xaxis=f"x{number}", yaxis=f"y{number}")
        )  # fmt: skip
        title = f"{profile.name} ({named})" if named else profile.name
        frame[f"xaxis{number}"] = axis_of(
            title, domain=[left + 0.02, left + 0.94 / _ABREAST], anchor=f"y{number}"
        )
        frame[f"yaxis{number}"] = axis_of(
            "rise of the deviance" if column == 0 else "",
            domain=[max(top - tall + _GAP, 0.0), top],
            anchor=f"x{number}",
            range=[-0.3, _SHOWN],
            showticklabels=column == 0,
        )
    return {"data": data, "layout": layout_of(60 + 270 * rows, **frame)}


def _interpolated(values: Array, rise: Array) -> tuple[Array, Array]:
    """Return a profile drawn out between its points: its root is about straight on either side."""
    fine = np.union1d(values, np.linspace(values[0], values[-1], _POINTS_BETWEEN))
    side = np.sign(np.arange(len(values)) - int(np.argmin(rise)))
    return fine, np.interp(fine, values, side * np.sqrt(np.maximum(rise, 0.0))) ** 2
