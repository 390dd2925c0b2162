# SPDX-License-Identifier: Apache-2.0
"""The drive behind a lagging amplifier, against an integrator of its own."""

from __future__ import annotations

import numpy as np
import pytest
from bench_traces import Axis, Drive
from experiments import truth_of
from other_axes import Other, other_trace

from stickslip_ros.identification.experiment import Experiment, IdentificationError, Stepping
from stickslip_ros.identification.identify import identify
from stickslip_ros.identification.lag import lagged
from stickslip_ros.model import drive_of
from stickslip_ros.parameters import Parameters
from stickslip_ros.traces.motion import Motion

AXIS = Axis(preload=0.6, mass=5e-3, sigma_1=7.0)
KNOWN = {"preload": 0.6, "mass": 5e-3, "frequency": 400.0, "amplitude": 280.0}


@pytest.mark.usefixtures("compiled_solver")
@pytest.mark.parametrize("lag", [3e-7, 1.5e-6, 3e-6])
def test_twelve_lagging_cycles_are_those_of_the_integrator(lag: float) -> None:
    drive = Drive(12, frequency=400.0, amplitude=280.0, pause=5e-3)
    t, x = other_trace(AXIS, Other(lag=lag), drive, 5e5, 0.0, 3)
    p = Parameters.of({**KNOWN, **truth_of(AXIS)})
    experiment = Experiment(p, Motion("lab", t, x), (Stepping(5e-3, 12, 400.0),))
    found, _ = experiment.simulation(p, np.array([5e-3]), lag).sample(t)
    without, _ = experiment.simulation(p, np.array([5e-3])).sample(t)
    assert np.abs(found - x).max() < 1.5e-9
    assert np.abs(found - x).max() < 0.03 * np.abs(without - x).max()


@pytest.mark.parametrize("count", [1, 5])
def test_the_pieces_take_the_time_of_the_cycles_and_end_where_they_began(count: int) -> None:
    drive_cycle = drive_of(Parameters.of(KNOWN))
    pieces = lagged(drive_cycle, count, 1e-6)
    lasts = sum(often * piece.period for piece, often in pieces)
    assert sum(often for piece, often in pieces if piece.slip >= 0) == count
    assert lasts == pytest.approx(count * drive_cycle.period + 11e-6)
    strokes = [often * float(piece.durations @ piece.rates) for piece, often in pieces]
    assert sum(strokes) == pytest.approx(0.0, abs=1e-18)
    assert all((piece.durations > 0.0).all() for piece, _ in pieces)


def test_another_waveform_cannot_lag() -> None:
    t = np.arange(0.0, 0.05, 2e-6)
    x = 1e-7 * np.floor(np.clip(400.0 * (t - 5e-3), 0.0, 10.0))
    known = Parameters.of({**KNOWN, "waveform": "hold", "hold_before": 0.2})
    with pytest.raises(IdentificationError, match="a sawtooth on a linear actuator only"):
        identify([(known, Motion("lab", t, x))], fit_lag=True)
