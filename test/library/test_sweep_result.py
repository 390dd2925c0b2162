# SPDX-License-Identifier: Apache-2.0
"""Sweeps of the library: each point as alone, in the order given."""

import matplotlib
import numpy as np
import pytest

import stickslip_ros as ss

matplotlib.use("agg")


def test_every_point_is_as_it_is_alone() -> None:
    preloads, masses = [1.0, 0.4], np.array([0.003, 0.004, 0.01])
    found = ss.sweep(preload=preloads, mass=masses, metric=["step_size", "backstep"])
    for i, preload in enumerate(preloads):
        for j, mass in enumerate(masses):
            alone = ss.simulate(preload=preload, mass=float(mass), steps=12)
            assert found["step_size"][i, j] == alone.step_size
            assert found["backstep"][i, j] == alone.backstep
    table = found.to_frame()
    assert table["preload (N)"].tolist() == [1.0] * 3 + [0.4] * 3
    assert table["step_size (m)"].tolist() == found["step_size"].ravel().tolist()


def test_an_impossible_point_is_nan() -> None:
    found = ss.sweep(model="epm_calc", z_ba=1e-7, preload=[0.2, 1.0])
    assert np.isnan(found["step_size"]).tolist() == [True, False]


def test_what_cannot_be_swept_is_refused() -> None:
    for given, complaint in [
        ({}, "nothing varies"),
        ({"preload": []}, "preload has no values"),
        ({"preload": [0.5], "metric": "stepsize"}, "did you mean step_size"),
        ({"model": ["ceim", "lugre"]}, "could not convert|not a number"),
    ]:
        with pytest.raises((ss.SweepError, ValueError), match=complaint):
            ss.sweep(**given)  # type: ignore[arg-type]


def test_a_map_is_drawn_over_two_parameters() -> None:
    axes = ss.sweep(preload=[0.5, 1.0], mass=[0.003, 0.004]).plot()
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("mass (g)", "preload (N)")
