# SPDX-License-Identifier: Apache-2.0
"""Which of the steps after a rest are settled, the one rule for simulated and measured ones."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

#: Number of first steps from rest that differ from the settled ones and are left out of means; so
#: many steps are kept at least, or the second half of fewer than twice as many.
SETTLING, KEPT = 7, 4
#: A step is measurable from here on, m: ten times the accuracy that the model is solved to.
MEASURABLE = 1e-10
#: Steps from rest by which an operating point is judged.
TRIAL_STEPS = SETTLING + 5


def settled_from(steps: int) -> int:
    """Return how many of the first steps after a rest means leave out.

    The one rule for simulated and measured runs, for steps and for backsteps. A longer run keeps
    as many steps as a shorter one, or more.
    """
    return min(SETTLING, max(steps // 2, steps - KEPT))


def settled_mean(values: NDArray[np.float64]) -> Any:
    """Return the mean over the settled steps, those from `settled_from` on, along the last axis.

    values has shape (steps,) or (points, steps). nan values are left out; nan if nothing is left.
    """
    kept = values[..., settled_from(values.shape[-1]) :]
    finite = np.isfinite(kept)
    with np.errstate(invalid="ignore"):
        mean = np.where(finite, kept, 0.0).sum(axis=-1) / finite.sum(axis=-1)
    return mean if values.ndim > 1 else float(mean)
