# SPDX-License-Identifier: Apache-2.0
"""The force that an axis generates: its runner pushes a spring until it gets no further (Fig. 15).

Each step presses the spring a little more, until slip and stick cost as much as they bring.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.model.friction import value_or
from stickslip_ros.parameters import Parameters
from stickslip_ros.studies.operating_points import batch_of
from stickslip_ros.traces.steps import MEASURABLE

#: N/m, where the parameter ``spring`` is not set: a stiff force sensor.
SPRING = 1e6
#: Cycles over which the position is averaged, and cycles after which a run is given up.
_BLOCK, _LIMIT = 10, 100_000


def generated_forces(p: Parameters, points: int, steps: int) -> NDArray[np.float64]:
    """Return the generated force (N) of a column set, (points,): spring times final position.

    The spring is that of p, or `SPRING`; only the sign of steps counts. Positions at
    the ends of cycles are averaged over ten cycles; the run ends when this mean has risen by less
    than `MEASURABLE` over that of the ten cycles before, 0.01 nm a cycle. nan where it still rises
    after 100 000 cycles.
    """
    spring = value_or(p.runner.spring, SPRING)
    batch, possible = batch_of(p.replace(spring=spring), points, 1 if steps >= 0 else -1)
    return spring * batch.run_until_still(_BLOCK, MEASURABLE, _LIMIT, possible)  # type: ignore[no-any-return]
