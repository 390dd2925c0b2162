# SPDX-License-Identifier: Apache-2.0
"""The Kalman filter on curves against an ensemble of axes, by another package where it is there."""

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from stickslip_ros.axis import Axis
from stickslip_ros.parameters import Parameters
from stickslip_ros.twin import Twin, TwinCommand, TwinSettings
from stickslip_ros.twin.response import CycleCurve, parts_of_cycles

P = Parameters.of(frequency=100.0)
MEMBERS = 400


def test_an_ensemble_kalman_filter_finds_the_same() -> None:
    """Each member of filterpy's goes by the curve of its own preload: no derivative is taken."""
    kalman = pytest.importorskip("filterpy.kalman")
    axis, random = Axis(P.replace(preload=0.38)), np.random.default_rng(7)
    twin = Twin(P, TwinSettings(gain_deviation=1e-9))
    twin.command(TwinCommand(0.0, "steps", 150.0))
    axis.command_steps(150)
    readings = []
    for k in range(1, 150):
        axis.advance(0.01 * k + 0.004 + 0.003 * random.random())  # where the ringing is small
        readings.append((axis.state.t, axis.state.x + 2e-9 * random.standard_normal()))
        twin.measure(*readings[-1])
    thetas = np.linspace(-0.25, 0.25, 11)
    models = [P.replace(preload=0.4 * math.exp(one)) for one in thetas]
    seen = [one for one, *_ in twin._seen]
    drive = seen[-1].parts[-1][0].drive
    assert drive and not twin.changes
    curves = [CycleCurve.of(p, drive) for p in models]
    filtered = kalman.EnsembleKalmanFilter(
        x=np.array([readings[0][1], 0.0]), P=np.diag([2e-9, 0.05]) ** 2, dim_z=1, dt=0.01,
        N=MEMBERS, hx=lambda state: state[:1], fx=lambda state, _: state,
    )  # fmt: skip
    np.random.seed(7)
    for (before, _), (t, reading), one in zip(
        *zip(*pairwise(readings), strict=True), seen, strict=True
    ):
        at = parts_of_cycles(one.parts[-1][0], before, t)
        way = CubicSpline(thetas, [np.diff(curve.at(*at))[0] for curve in curves])
        filtered.fx = lambda state, _, way=way: state + np.array([way(state[1]), 0.0])
        filtered.Q = np.diag([one.motion.scatter, 0.0])
        filtered.predict()
        blur = one.motion.blur
        filtered.update(np.array([reading]), np.array([[4e-18 + blur.deviation**2]]))
    found, deviation = twin.tracker.theta[0], twin.tracker.deviations[0]
    ensemble, spread = filtered.sigmas[:, 1].mean(), filtered.sigmas[:, 1].std()
    assert abs(found - ensemble) < deviation
    assert 1.0 < deviation / spread < 2.0  # it takes readings in the ringing for related
    assert abs(found - math.log(0.95)) < 3.0 * deviation
