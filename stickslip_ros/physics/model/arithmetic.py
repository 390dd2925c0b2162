# SPDX-License-Identifier: Apache-2.0
"""How this machine rounds: a digest of what results depend on beside the code.

Sums and products are IEEE arithmetic in a fixed order, the same everywhere. Exponentials, cosines
and powers come from the system's mathematical library, which has other versions of them for
processors without fused operations, and normal numbers from NumPy. So a recording repeats to the
last bit where this digest is that of the recording; elsewhere the last digits may differ. For the
same reason, nothing that is recorded or simulated again uses NumPy's own exponentials and powers,
nor linear algebra: both choose their code by the processor.
"""

from __future__ import annotations

import hashlib
import math
import struct
from functools import lru_cache

import numpy as np

#: Arguments that are tried: of each function one in a thousand differs between two libraries
_TRIED, _SPACING = 4000, 6.85e-3
#: Normal numbers that are drawn
_DRAWN = 1000


@lru_cache(maxsize=1)
def arithmetic() -> str:
    """Return the digest of this machine's arithmetic, 16 hexadecimal digits."""
    found = hashlib.sha256()
    for k in range(_TRIED):
        found.update(struct.pack("<14d", *_values((k + 1) * _SPACING, (k + 0.5) / _TRIED)))
    normals = np.random.RandomState(1).standard_normal(_DRAWN)
    between = np.interp(np.arange(_DRAWN) / 3.0, np.arange(_DRAWN), normals)
    for part in (normals, between):
        found.update(part.astype("<f8").tobytes())
    return found.hexdigest()[:16]


def _values(x: float, part: float) -> tuple[float, ...]:
    """Return what the solver takes from the mathematical library, at x and a part of 1."""
    return (
        math.exp(-x), math.expm1(-x), math.log(x), math.log1p(x), math.log10(x),
        math.sin(x), math.cos(x), math.asin(part), math.atan(x), math.atanh(part),
        x ** (1.0 / 3.0), x**0.2, 10.0 ** (8.0 * part), math.cbrt(x) + math.hypot(x, part),
    )  # fmt: skip
