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
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.compiled import compiled

#: Arguments that are tried: of exponentials one in a thousand differs between two libraries
_TRIED, _SPACING = 20_000, 1.37e-3
#: Normal numbers that are drawn
_DRAWN = 1000


@lru_cache(maxsize=1)
def arithmetic() -> str:
    """Return the digest of this machine's arithmetic, 16 hexadecimal digits."""
    values = np.empty((_TRIED, 14))
    _evaluate(values)
    normals = np.random.RandomState(1).standard_normal(_DRAWN)
    between = np.interp(np.arange(_DRAWN) / 3.0, np.arange(_DRAWN), normals)
    found = hashlib.sha256()
    for part in (values, normals, between):
        found.update(part.astype("<f8").tobytes())
    return found.hexdigest()[:16]


@compiled
def _evaluate(out: NDArray) -> None:
    """Write what the solver takes from the mathematical library, (arguments, 14)."""
    for k in range(len(out)):
        x = (k + 1) * _SPACING
        part = (k + 0.5) / len(out)
        out[k, 0], out[k, 1], out[k, 2] = math.exp(-x), math.sin(x), math.cos(x)
        out[k, 3], out[k, 4], out[k, 5] = math.log(x), math.log1p(x), math.expm1(-x)
        out[k, 6], out[k, 7], out[k, 8] = x ** (1.0 / 3.0), x**0.2, np.cbrt(x)
        out[k, 9], out[k, 10], out[k, 11] = 10.0 ** (8.0 * part), math.log10(x), math.hypot(x, part)
        out[k, 12], out[k, 13] = math.atanh(part), math.asin(part) + math.atan(x)
