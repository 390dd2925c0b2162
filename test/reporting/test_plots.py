# SPDX-License-Identifier: Apache-2.0
"""Lines of plots with few points."""

import numpy as np

from stickslip_ros.reporting.plots import thin_columns


def test_thinning_keeps_the_peaks() -> None:
    t = np.linspace(0.0, 1.0, 1_000_000)
    x = np.zeros_like(t)
    x[123_456], x[654_321] = 1.0, -1.0
    thin_t, thin_x = thin_columns(t, x, count=1000)
    assert len(thin_t) <= 1002
    assert (thin_x.max(), thin_x.min()) == (1.0, -1.0)
    assert (np.diff(thin_t) > 0.0).all()
