# SPDX-License-Identifier: Apache-2.0
"""Fewer samples for a plot, with every peak kept."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def thinned(t: Array, *columns: Array, count: int) -> tuple[Array, ...]:
    """Return t and the columns at about so many samples: lowest and highest of each stretch.

    Every column's extremes are kept, so lines look as they do with all samples.
    """
    if len(t) <= count:
        return (t, *columns)
    stretches = np.array_split(np.arange(len(t)), max(1, count // (2 * len(columns))))
    kept = {0, len(t) - 1}
    for stretch in stretches:
        for column in columns:
            part = column[stretch]
            kept |= {int(stretch[np.argmin(part)]), int(stretch[np.argmax(part)])}
    at = np.array(sorted(kept))
    return (t[at], *(column[at] for column in columns))
