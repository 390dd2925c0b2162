# SPDX-License-Identifier: Apache-2.0
"""Fig. 1 and 2, Eq. 9, section 4.5: the response to a sawtooth, the actuator's part in it."""

from __future__ import annotations

from dataclasses import astuple

import numpy as np
from matplotlib.figure import Figure

from stickslip_ros.library.zero_amplitude import zero_amplitudes
from stickslip_ros.measurement.actuator_identification import identify_hysteresis
from stickslip_ros.model import DriveCycle, Plant, drive_of
from stickslip_ros.model.actuator import Actuator
from stickslip_ros.pages.response import draw_closer, draw_cycles
from stickslip_ros.paper.claim import ClaimVerdict, Result
from stickslip_ros.paper.parameter_sets import (
    FULL_DEFLECTION,
    FULL_VOLTAGE,
    TABLE_1_VIBRATION,
    Array,
    columns,
    steps_and_backsteps,
)
from stickslip_ros.parameters import Parameters
from stickslip_ros.solver import Simulation
from stickslip_ros.traces.analysis import analyse_steps
from stickslip_ros.traces.steps import TRIAL_STEPS
from stickslip_ros.traces.trace import HEADER, Trace, points, trace_steps

#: A swing of the ringing that counts, m.
_SWING = 1e-9
#: Preloads of the balance of Eq. 9, N.
_PRELOAD = np.array([0.4, 1.0, 2.0, 3.0])
#: Width of the actuator's loop, part of its stroke, and samples of a cycle.
WIDTHS, _TYPICAL, _SAMPLES = np.linspace(0.0, 0.3, 7), 0.15, 4000
#: A loop as from a bench, by a law that the package does not use (Bouc and Wen): shares and rates
#: that make it 15 % wide, and samples of each branch.
_SHARE, _BETA, _GAMMA, _BRANCH = 0.365, 4.0, 0.5, 2000


def response() -> Result:
    """Trace four cycles from rest and look at the first and second."""
    p = columns(TABLE_1_VIBRATION)
    trace, drive_cycle, contact = trace_steps(p, 4), drive_of(p), Plant.of(p).contact
    cycles = [points(trace, drive_cycle, contact, k) for k in range(3)]
    first, second = cycles[0], cycles[1]
    falling = (trace.t >= first["C"]) & (trace.t <= first["D"])
    backstep = max(trace.x[falling]) - float(np.interp(first["E"], trace.t, trace.x))
    ringing = trace.z[(trace.t > second["F"]) & (trace.t < cycles[2]["C"])]
    turned = np.flatnonzero(np.diff(np.sign(np.diff(ringing)))) + 1

    def draw(figure: Figure) -> None:
        grid = figure.add_gridspec(3, 2)
        overview = figure.add_subplot(grid[0, :])
        draw_cycles(overview, trace, drive_cycle, cycles)
        slipping = float(drive_cycle.durations[drive_cycle.slip])
        for place, names, window, what in (
            (grid[1, 0], "AB", (-10e-6, 400e-6), "the start: presliding"),
            (grid[1, 1], "CD", (-0.2 * slipping, slipping), "the slip of the actuator"),
            (grid[2, :], "CDEF", (-150e-6, 1500e-6), "backstep and ringing"),
        ):
            axes = figure.add_subplot(place)
            draw_closer(axes, trace, first, names, first[names[0]], window, what)
        handles, labels = overview.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=2, fontsize=8.5)

    values = {
        "points A to F that are out of order": np.sum(
            ~(np.diff([second[name] for name in "ABCDEF"]) > 0.0)
        ),
        "backstep in the slip": backstep,
        "swings above 1 nm after the backstep": np.sum(np.abs(ringing[turned]) > _SWING),
    }
    table = dict(zip(HEADER, astuple(trace), strict=True))
    return Result(values, tables={"": table}, draw=draw, size=(6.2, 9.0))


def _hysteretic(width: float) -> Parameters:
    return columns({"actuator": "hysteresis", "hysteresis": float(width)})


def from_fresh_actuator(p: Parameters, cycles: int) -> Trace:
    """Return cycles of an actuator that has never moved, so that its first rise is the longest."""
    actuator, plant = Actuator.of(p.actuator), Plant.of(p)
    linear = drive_of(p.replace(actuator="linear"))
    durations, rates, _ = actuator.follow(
        actuator.rest(),
        np.tile(linear.durations, cycles),
        np.tile(linear.rates / p.actuator.gain, cycles),
    )
    simulation = Simulation(plant, p.solver.tolerance)
    simulation.start(DriveCycle(durations, rates, slip=-1, sign=1), 1)
    slip = float(np.sum(linear.durations[: linear.slip]))
    times = np.unique(np.linspace(0.0, cycles * linear.period, cycles * _SAMPLES + 1))
    times = np.union1d(times, slip + linear.period * np.arange(cycles))
    samples = np.empty((7, len(times)))
    for k, t in enumerate(times):
        simulation.advance(float(t))
        s = simulation.state
        samples[:, k] = s.t, s.x, s.v, s.u, s.z, s.w, s.force
    return Trace(*samples)


def _from_line(trace: Trace, start: float, end: float) -> float:
    """Return the largest distance (m) of the runner from a straight line between two times (s)."""
    between = (trace.t > start) & (trace.t < end)
    t, x = trace.t[between], trace.x[between]
    return float(np.max(np.abs(x - np.polyval(np.polyfit(t, x, 1), t))))


def shape() -> Result:
    """What Fig. 2 shows beside the phases: a bent stick, and one short of the amplitude."""
    p = _hysteretic(_TYPICAL)
    trace = from_fresh_actuator(p, 3)
    linear = drive_of(p.replace(actuator="linear"))
    period, slip = linear.period, float(np.sum(linear.durations[: linear.slip]))

    slips = [float(np.interp(k * period + slip, trace.t, trace.u)) for k in (0, 1)]
    amplitude = slips[0]
    second = slips[1] - float(np.interp(period, trace.t, trace.u))

    corners = np.cumsum([0.0, *np.tile(linear.durations[linear.durations > 0.0], 3)])
    voltage = {
        "time (s)": corners,
        "gain times voltage (m)": amplitude * np.array([0.0, 1.0, 0.0, 1.0, 0.0, 1.0, 0.0]),
    }
    values = {
        "second stick away from a straight line, later half": _from_line(
            trace, 1.5 * period, period + slip
        ),
        "second rise of the actuator short of gain times voltage": amplitude - second,
        "first rise of the actuator: gain times voltage": amplitude,
        "second rise of the actuator": second,
    }
    table = {"time (s)": trace.t, "runner (m)": trace.x, "actuator (m)": trace.u}
    return Result(values, tables={"": table}, drawn={"voltage": voltage})


def measured_loop() -> tuple[Array, Array]:
    """Return voltage (V) and deflection (m) of a settled loop after Bouc and Wen."""
    up = np.linspace(0.0, 1.0, _BRANCH)
    voltage = np.tile(np.concatenate([up, up[::-1]]), 4)
    inner = np.zeros(len(voltage))
    for k, step in enumerate(np.diff(voltage)):
        h = inner[k]
        inner[k + 1] = h + step - _BETA * abs(step) * h - _GAMMA * step * abs(h)
    last = slice(-2 * _BRANCH, None)
    deflection = (voltage - _SHARE * inner)[last]
    scaled = FULL_DEFLECTION * (deflection - deflection[0]) / np.ptp(deflection)
    return FULL_VOLTAGE * voltage[last], scaled


def hysteresis() -> Result:
    """Steps over the width of the loop, a step with and without, and an identified loop."""
    found = [steps_and_backsteps({"actuator": "hysteresis", "hysteresis": w}) for w in WIDTHS]
    step, backstep = (np.array([float(pair[k][0]) for pair in found]) for k in (0, 1))
    typical = int(np.argmin(np.abs(WIDTHS - _TYPICAL)))
    volts, deflection = measured_loop()
    identified = identify_hysteresis(volts, deflection, 8)
    linear, bent = trace_steps(_hysteretic(0.0), 3), trace_steps(_hysteretic(_TYPICAL), 3)
    drive_cycle = drive_of(_hysteretic(0.0))
    slip = float(np.sum(drive_cycle.durations[: drive_cycle.slip]))

    values = {
        "first stick away from a straight line, 15 %": _from_line(bent, 0.0, slip),
        "the same, linear actuator": _from_line(linear, 0.0, slip),
        "change of the step size by 15 %": 100.0 * abs(float(step[typical] / step[0]) - 1.0),
        "change of the backstep by 15 %": 100.0 * float(backstep[typical] / backstep[0] - 1.0),
        "width of a loop after Bouc and Wen": 100.0 * identified.width,
        "largest error of this loop, identified": 100.0 * identified.error,
    }
    return Result(
        values,
        tables={
            "": {"width": WIDTHS, "step size (m)": step, "backstep (m)": backstep},
            "_loop": {"voltage (V)": volts, "deflection (m)": deflection},
        },
        drawn={
            name: {"time (s)": trace.t, "runner (m)": trace.x}
            for name, trace in (("linear", linear), ("bent", bent))
        },
    )


def balance() -> Result:
    """Eq. 9 over preload: stroke, backstep and 0-amplitude against the step."""
    step, backstep = steps_and_backsteps({}, preload=_PRELOAD)
    zero = zero_amplitudes(columns({}, preload=_PRELOAD), len(_PRELOAD), TRIAL_STEPS)
    left = FULL_DEFLECTION - backstep - zero
    lasting = np.array([_lasting_backstep(float(f)) for f in _PRELOAD])
    printed_backstep, printed_step = 0.3 * 130e-9, 130e-9
    values = {
        "Eq. 9 with stroke and backstep of Table 1 and 0-amplitude at 0.4 N": FULL_DEFLECTION
        - printed_backstep
        - float(zero[0]),
        "0-amplitude that Table 1 leaves room for": FULL_DEFLECTION
        - printed_backstep
        - printed_step,
        **{
            f"{what}, over the step, at {f:g} N": a / b
            for what, values in (
                ("Eq. 9", left),
                ("stroke less the lasting backstep", FULL_DEFLECTION - lasting),
            )
            for f, a, b in zip(_PRELOAD, values, step, strict=True)
        },
    }
    table = {
        "preload (N)": _PRELOAD,
        "step (m)": step,
        "backstep (m)": backstep,
        "0-amplitude (m)": zero,
        "Eq. 9 (m)": left,
        "lasting backstep (m)": lasting,
    }
    return Result(values, tables={"": table}, settled=ClaimVerdict.CONTRADICTORY)


def _lasting_backstep(preload: float) -> float:
    """Return the part of the backstep (m) that the ringing does not give back."""
    p = columns({"preload": preload})
    trace = trace_steps(p, TRIAL_STEPS)
    found = analyse_steps(trace.t, trace.x, trace.u, frequency=p.drive.frequency, start=0.0).balance
    return found.backstep - found.regained
