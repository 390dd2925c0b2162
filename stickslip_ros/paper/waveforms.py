# SPDX-License-Identifier: Apache-2.0
"""Section 4.2: a slip in two parts that leaves no vibration, and holds that lengthen the step."""

from __future__ import annotations

import numpy as np

from stickslip_ros.library.waveform_search import (
    elongate_step,
    elongation_map,
    shape_slip,
    shaping_map,
)
from stickslip_ros.model import drive_of
from stickslip_ros.paper.claim import Result, Table
from stickslip_ros.paper.parameter_sets import Array, columns, mesh
from stickslip_ros.parameters import Parameters
from stickslip_ros.traces.trace import trace_steps

_PRELOADS = (0.4, 1.0)
_SPLITS, _LATENCIES = np.linspace(0.5, 1.0, 21), np.linspace(0.0, 1.0, 21)
#: Resolution of the map, m.
_FINEST = 1e-10
#: Times that the picture shows, s after the slip begins.
_SHOWN = (-5e-5, 7e-4)
_FREQUENCY, _FREQUENCIES = 10e3, np.geomspace(100.0, 18e3, 14)
_HOLDS = np.linspace(0.0, 0.7, 36)
#: A gain that counts as an elongation.
_GAIN = 1.4


def shaping() -> Result:
    """The best split and latency at two preloads, maps around them, a slip with and without."""
    values: dict[str, float] = {}
    tables: dict[str, Table] = {}
    drawn: dict[str, Table] = {}
    every = {preload: shape_slip(columns({"preload": preload})) for preload in _PRELOADS}
    for preload, best in every.items():
        p = columns({"preload": preload})
        latencies = _LATENCIES * best.ringing_period
        ringing = shaping_map(p, _SPLITS, latencies).ravel()
        place = {"split": best.split, "latency (periods)": best.latency / best.ringing_period}
        at = f"at {preload:g} N"
        values |= {
            f"ringing, two parts over single slip, {at}": best.ringing_after / best.ringing_before,
            f"ringing, single slip, {at}": best.ringing_before,
            f"step, single slip, {at}": best.step_before,
            f"step, two parts, {at}": best.step_after,
            f"first part, {at}": 100.0 * best.split,
            f"latency, {at}": place["latency (periods)"],
        }
        split, latency = mesh(_SPLITS, latencies)
        tables[f"_{preload:g}N"] = {
            "split": split, "latency (s)": latency, "ringing (m)": ringing,
        }  # fmt: skip
        drawn |= {
            f"best {at}": {name: np.array([value]) for name, value in place.items()},
            at: {
                "split": split,
                "latency (periods)": mesh(_SPLITS, _LATENCIES)[1],
                "ringing (m)": np.maximum(ringing, _FINEST),
            },
        }
    p, best = columns({"preload": _PRELOADS[0]}), every[_PRELOADS[0]]
    time, single = _after_slip(p)
    _, double = _after_slip(p.replace(waveform="shaped", split=best.split, latency=best.latency))
    table = {"time (s)": time, "runner, single slip (m)": single, "runner, two parts (m)": double}
    return Result(values, tables={"": table, **tables}, drawn=drawn)


def _after_slip(p: Parameters) -> tuple[Array, Array]:
    """Return times from the begin of the first slip (s) and the runner from there (m)."""
    trace, drive_cycle = trace_steps(p, 2), drive_of(p)
    slip = float(np.sum(drive_cycle.durations[: drive_cycle.slip]))
    t = np.linspace(*_SHOWN, 1500)
    x = np.interp(slip + t, trace.t, trace.x)
    return t, x - float(np.interp(slip, trace.t, trace.x))


def elongation() -> Result:
    """The best holds at 10 kHz, the map around them, and the best gain over frequency."""
    best = elongate_step(columns({"frequency": _FREQUENCY}))
    before, after = mesh(_HOLDS, _HOLDS)
    step = elongation_map(columns({"frequency": _FREQUENCY, "waveform": "hold"}), before, after)
    every = [elongate_step(columns({"frequency": f})) for f in _FREQUENCIES.tolist()]
    gain = np.array([found.step_after / found.step_before for found in every])
    enough = gain >= _GAIN
    first = float(_FREQUENCIES[enough][0]) if enough.any() else float("nan")

    values = {
        "best step over the plain one at 10 kHz": best.step_after / best.step_before,
        "plain step at 10 kHz": best.step_before,
        "longest step at 10 kHz": best.step_after,
        "best gain at 100 Hz": gain[0],
        "lowest frequency of the curve with a gain of 1.4": first,
        "hold before the slip": 100.0 * best.hold_before,
        "hold after the slip": 100.0 * best.hold_after,
    }
    table = {"frequency (Hz)": _FREQUENCIES, "best gain": gain}
    tried = {"hold before (T)": before, "hold after (T)": after, "step (m)": step}
    holds = {"hold before (T)": best.hold_before, "hold after (T)": best.hold_after}
    drawn = {"best_map": {name: np.array([hold]) for name, hold in holds.items()}}
    return Result(values, tables={"": table, "_map": tried}, drawn=drawn)
