# SPDX-License-Identifier: Apache-2.0
"""The Kalman filter on curves against the posterior of all readings at once, without a filter."""

import math
from itertools import combinations, pairwise

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.stats import multivariate_normal

from stickslip_ros.axis import Axis
from stickslip_ros.measurement.twin import Twin, TwinCommand, TwinSettings
from stickslip_ros.measurement.twin.response import CycleCurve, parts_of_cycles
from stickslip_ros.physics.parameters import Parameters

P = Parameters.of(frequency=100.0)


def test_the_posterior_of_an_ensemble_of_axes_is_the_same() -> None:
    """Each of 401 axes goes by the curve of its own preload: no derivative is taken.

    The readings of an axis are jointly normal, as steps scatter and readings are blurred.
    """
    axis, random = Axis(P.replace(preload=0.38)), np.random.default_rng(7)
    held = TwinSettings(gain_deviation=1e-9, drift_hour=1e-9, drift_metre=1e-9)  # one unknown
    twin = Twin(P, held)
    twin.command(TwinCommand(0.0, "steps", 250.0))
    axis.command("steps", 250)
    readings = []
    for k in range(1, 250):
        axis.advance(0.01 * k + 0.004 + 0.003 * random.random())  # where the ringing is small
        readings.append(axis.state.x + 2e-9 * random.standard_normal())
        twin.measure(axis.state.t, readings[-1])
    seen = [one for one, _ in twin._seen]
    drive = seen[-1].parts[-1][0].drive
    assert drive and not twin.changes and len(seen) == 248
    solved, thetas = np.linspace(-0.25, 0.25, 11), np.linspace(-0.25, 0.25, 401)
    curves = [CycleCurve.of(P.replace(preload=0.4 * math.exp(one)), drive) for one in solved]
    (piece, *_), times = seen[0].parts[0], [twin._anchored, *(one.t for one in seen)]
    at = parts_of_cycles(piece, *times)
    ways = CubicSpline(solved, [curve.at(*at)[1:] - curve.at(*at)[0] for curve in curves])(thetas)
    scatter = np.cumsum([one.motion.scatter for one in seen])
    # Ringing is alike in readings at one phase after a slip, less with each uncertain time.
    first = twin.tracker.model.curve(drive).blur(piece, times[0], twin.settings.timing)
    blurs = [first, *(one.motion.blur for one in seen)]
    alike = [math.cos(b.turned - a.turned) * b.coherence for a, b in pairwise(blurs)]
    ringing = np.diag([one.ringing**2 for one in blurs])
    for i, j in combinations(range(len(blurs)), 2):
        shared = blurs[i].ringing * blurs[j].ringing * math.prod(alike[i:j])
        ringing[i, j] = ringing[j, i] = shared
    read = ringing + np.diag([twin.settings.noise**2 + one.timing**2 for one in blurs])
    since_first = np.eye(len(blurs))[1:] - np.eye(len(blurs))[0]
    covariance = since_first @ read @ since_first.T + np.minimum.outer(scatter, scatter)
    differences = 1e9 * (since_first @ readings - ways)  # nm
    likely = multivariate_normal(cov=1e18 * covariance).logpdf(differences)
    posterior = np.exp(likely - likely.max() - 0.5 * (thetas / 0.05) ** 2)
    mean = np.average(thetas, weights=posterior)
    spread = math.sqrt(np.average((thetas - mean) ** 2, weights=posterior))
    found, deviation = twin.tracker.theta[0], twin.tracker.deviations[0]
    assert abs(found - mean) < 0.2 * deviation
    assert 0.95 < deviation / spread < 1.05
    assert abs(found - math.log(0.95)) < 3.0 * deviation
